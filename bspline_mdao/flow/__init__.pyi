"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .loads.hinges import HingeMoment as HingeMoment
from .loads.induced_drag import Wake as Wake
from .loads.induced_drag import least_drag as least_drag
from .loads.rigid_links import RigidLinks as RigidLinks
from .om.aerostructure import Aerostructure as Aerostructure
from .om.aerostructure import Spar as Spar
from .om.flow_run import run_flow as run_flow
from .om.openfoam_flow import OpenFoamFlow as OpenFoamFlow
from .om.openfoam_flow import ReferenceWarning as ReferenceWarning
from .om.series_recorder import SeriesRecorder as SeriesRecorder
from .om.snapshots import Snapshot as Snapshot
from .om.su2_flow import Su2Flow as Su2Flow
from .om.vortex_lattice import VortexLattice as VortexLattice
from .openfoam.inviscid import InviscidCase as InviscidCase
from .openfoam.inviscid import openfoam_forces as openfoam_forces
from .openfoam.rans_case import RansCase as RansCase
