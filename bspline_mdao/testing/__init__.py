"""Checks of derivatives: for those who write their own variables, kernels and components.

Each takes what is to be checked from its caller, a function or an OpenMDAO problem, and none passes where there is
nothing to compare: empty vectors, derivatives that are all zero and functions that do not change are errors. The order
in which they are used is that of the chain of trust: complex step of the function, against it forward products, against
them reverse products (`dot_test`), then partials of the component and totals of the problem.
"""

from .derivatives import central_difference as central_difference
from .derivatives import complex_step as complex_step
from .derivatives import dot_test as dot_test
from .derivatives import richardson as richardson
from .derivatives import taylor_rate as taylor_rate
from .problems import TotalsCheck as TotalsCheck
from .problems import assert_partials as assert_partials
from .problems import check_totals as check_totals
from .problems import perturb_design as perturb_design
from .problems import total_difference as total_difference
from .variables import VariableCheck as VariableCheck
from .variables import check_variable as check_variable
