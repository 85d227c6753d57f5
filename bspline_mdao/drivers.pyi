"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.om.drivers.combinations import combine as combine
from .core.om.drivers.combinations import even_combinations as even_combinations
from .core.om.drivers.combinations import even_pressures as even_pressures
from .core.om.drivers.recorded_run import RecordedRun as RecordedRun
from .core.om.drivers.recorded_run import disagreement as disagreement
from .core.om.drivers.recorded_run import nlopt as nlopt
from .core.om.drivers.recorded_run import recorded as recorded
from .core.om.drivers.recorded_run import run_at as run_at
from .core.om.drivers.recorded_run import scipy_slsqp as scipy_slsqp
from .core.om.drivers.short_records import short_records as short_records
from .studio.report.design_summary import DesignSummary as DesignSummary
