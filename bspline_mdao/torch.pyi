"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.bridges.torch_functions import grid as grid
from .core.bridges.torch_functions import measures as measures
from .core.bridges.torch_functions import quality as quality
