"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .cells.curved_grid import CurvedGrid as CurvedGrid
