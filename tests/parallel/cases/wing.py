"""The run script of a wing on several processes: the first rank prints its numbers."""

import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[3] / "run_scripts"))
import parallel_wing

from bspline_mdao.base.numerics.processes import world

numbers = parallel_wing.main(quick=True)
if world().rank == 0:
    print(json.dumps(numbers))
