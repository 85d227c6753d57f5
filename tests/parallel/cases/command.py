"""A command of the command line: its exit status goes to the end of what is printed."""

import sys

from bspline_mdao.studio.cli.main import run

print(run(sys.argv[1:]), flush=True)
