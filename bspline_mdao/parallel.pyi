"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .base.numerics.processes import from_all as from_all
from .base.numerics.processes import summed as summed
from .base.numerics.processes import together as together
from .base.numerics.processes import world as world
from .grids.topology.partition import Partition as Partition
from .grids.topology.partition import Subdomain as Subdomain
