"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.adaptation.improve import improve_grid as improve_grid
from .core.adaptation.improvement import Improvement as Improvement
from .flow.om.adapt_grid import adapt_grid as adapt_grid
from .flow.om.adaptation import Adaptation as Adaptation
from .flow.om.error_estimate import error_estimate as error_estimate
