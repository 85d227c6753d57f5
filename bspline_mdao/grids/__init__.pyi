"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .cells.curved_grid import CurvedGrid as CurvedGrid
from .cells.grid_quality import GridQuality as GridQuality
from .cells.hexahedron import cell_quality as cell_quality
from .cells.report import judge_move as judge_move
from .cells.report import report_quality as report_quality
from .io.patch_guess import guess_patches as guess_patches
from .io.patch_guess import with_guessed_patches as with_guessed_patches
from .topology.grid import Block as Block
from .topology.grid import Patch as Patch
from .topology.index_space import Window as Window
