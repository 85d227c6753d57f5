"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.design.linear_constraints import InPlane as InPlane
from .core.design.linear_constraints import Linked as Linked
from .core.design.linear_constraints import Mirrored as Mirrored
from .core.design.linear_constraints import Opposite as Opposite
from .core.design.linear_constraints import Pinned as Pinned
from .core.design.tangent_continuity import TangentContinuity as TangentContinuity
from .core.om.monotonic import Monotonic as Monotonic
