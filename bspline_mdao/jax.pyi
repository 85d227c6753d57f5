"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.bridges.jax_evaluation import device_grid as device_grid
from .core.bridges.jax_functions import grid as grid
from .core.bridges.jax_functions import measures as measures
from .core.bridges.jax_functions import quality as quality
