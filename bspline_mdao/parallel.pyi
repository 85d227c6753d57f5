"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .grids.topology.partition import Partition as Partition
from .grids.topology.partition import Share as Share
