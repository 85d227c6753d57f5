"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.om.sampling.designs import Designs as Designs
from .core.om.sampling.plans import LatinHypercube as LatinHypercube
from .core.om.sampling.plans import Sobol as Sobol
from .core.om.sampling.plans import Table as Table
from .core.om.sampling.sample import sample as sample
