"""Public names: each is imported when it is first asked for, from the module that is written here."""

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
