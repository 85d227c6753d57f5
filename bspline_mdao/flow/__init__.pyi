"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .loads.hinges import HingeMoment as HingeMoment
from .loads.rigid_links import RigidLinks as RigidLinks
from .om.series_recorder import SeriesRecorder as SeriesRecorder
from .om.snapshots import Snapshot as Snapshot
from .om.vortex_lattice import VortexLattice as VortexLattice
