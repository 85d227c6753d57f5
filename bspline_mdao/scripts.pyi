"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .studio.run_script import pick_size as pick_size
from .studio.run_script import run as run
