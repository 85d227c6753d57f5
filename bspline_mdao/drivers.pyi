"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.om.drivers.combinations import combine as combine
from .core.om.drivers.combinations import even_combinations as even_combinations
from .core.om.drivers.combinations import even_pressures as even_pressures
from .core.om.drivers.short_records import short_records as short_records
