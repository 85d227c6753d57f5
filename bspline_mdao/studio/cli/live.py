"""The command ``live``: a model in a browser, deformed interactively."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.background.mesh_file import is_mesh_model
from ...core.mesh.boundary import moving_mesh
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ..live.opened import studied_model
from ..live.page import LOOPBACK, Page, require_trame
from ..live.session import Session
from ..live.shape import LiveModel
from .movers import MoverOptions
from .output import print_lines, print_title, print_warnings

__all__ = ["LiveOptions", "open_live"]


@dataclass(frozen=True)
class LiveOptions:
    """Options of the command ``live``; options of movement are as in ``move``."""

    output: Path = Path(".")  # folder of files that the page writes
    host: str = LOOPBACK  # address to listen on
    port: int = 0  # 0 for a free one
    has_browser: bool = True  # whether a browser is opened
    deform: tuple[str, ...] = ()  # deformations that get a slider, up to the given value
    design: tuple[str, ...] = ()
    slide: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    release: tuple[str, ...] = ()
    mover: MoverOptions = field(default_factory=MoverOptions)


def open_live(file: Path, options: LiveOptions) -> None:
    """Serve the page of a model, or of a study, until it is interrupted."""
    require_trame()
    if options.output.exists() and not options.output.is_dir():
        raise InputError(f"{options.output}: is a file; name a folder for what the page writes")
    with progress_bar() as progress:
        progress(0.0, "reading")
        live = (_of_study if file.suffix == ".toml" else _of_model)(file, options)
        progress(0.5, "trying a move")
        page = Page(Session(live, options.output))
    model, mesh = live.model, live.mesh
    n_points = f"{counted(len(mesh.surface_ids), 'control point')} of the surface"
    print_title(f"{file}: {counted(model.n_nodes, 'node')}, {counted(len(live.sliders), 'slider')}, {n_points}")
    if live.study is not None and live.study.n_values > len(live.sliders):
        print_warnings([f"the first {len(live.sliders)} of {live.study.n_values:,} values have sliders"])
    print_warnings([f"no {what}: {why}" for what, why in live.missing if why])
    page.on_ready(lambda port: print_lines([f"http://{options.host}:{port}/ is open; Ctrl+C ends it"]))
    page.serve(options.host, options.port, options.has_browser)


def _of_model(file: Path, options: LiveOptions) -> LiveModel:
    """Take a fitted model, with deformations by name."""
    if is_mesh_model(file):
        raise InputError(f"{file}: is a model of an unstructured mesh, which live does not show; see move and report")
    model = FittedModel.load(file)
    if not model.header.patches:
        raise InputError(f"{file}: its grid has no patches, so nothing says what moves; fit it again with --patches")
    mesh = moving_mesh(model, options.design or None, options.fix, options.release, options.slide)
    return LiveModel(model, mesh, options.mover.make(mesh), options.design or None, options.deform)


def _of_study(file: Path, options: LiveOptions) -> LiveModel:
    """Take the grid of a study, with its variables."""
    of_models = ("deform", "design", "fix", "release", "slide", "mover")
    if given := [name for name in of_models if getattr(options, name) != getattr(LiveOptions(), name)]:
        raise InputError(f"{file}: a study defines what moves and how; leave out --{given[0]}")
    return studied_model(file)
