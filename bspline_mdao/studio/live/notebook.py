"""The page of ``live`` in a notebook, served by its kernel while it is idle."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from secrets import token_hex

import numpy as np

from ...core.model.fitted_model import FittedModel
from ...grids.topology.grid import Grid
from .opened import studied_model
from .page import LOOPBACK, Page
from .session import Session
from .shape import LiveModel

__all__ = ["LiveView", "live"]

HEIGHT = 700
"""Height of the page in a notebook (pixels)."""


async def live(
    model: FittedModel | str | os.PathLike,
    *,
    deform: Sequence[str] = (),
    folder: str | os.PathLike = ".",
    height: int = HEIGHT,
) -> LiveView:
    """Show the page of the command ``live`` in a notebook: ``view = await live(model)``, and ``view`` to see it.

    The kernel serves the page at an address that only this machine reaches, while it runs no cell; the next cell sees
    what was dragged in the meantime.

    Parameters
    ----------
    model : FittedModel, str or path
        The model, or its file; or a study ``.toml``, whose variables are the sliders.
    deform : sequence of str
        Further deformations of a model that get a slider, as in the command.
    folder : str or path
        Folder for the files that the page writes.
    height : int
        Height of the page in the notebook (pixels).

    Returns
    -------
    LiveView

    Raises
    ------
    InputError
        If trame or VTK is missing, or the model cannot be moved.
    """
    if not isinstance(model, FittedModel):
        path = Path(model)
        prepared = studied_model(path) if path.suffix == ".toml" else LiveModel(FittedModel.load(path), asked=deform)
    else:
        prepared = LiveModel(model, asked=deform)
    page = Page(Session(prepared, Path(folder)), f"bspline_mdao live {token_hex(8)}")
    # as in a thread: the kernel's own interrupt handler stays
    page.serve(LOOPBACK, has_browser=False, exec_mode="task", thread=True)
    await page.server.ready
    return LiveView(page, height)


class LiveView:
    """The page of a model in a notebook, and the shape it shows. Made by `live`."""

    def __init__(self, page: Page, height: int) -> None:
        self._page, self._height = page, height

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{LOOPBACK}:{self._page.server.port}/"

    @property
    def values(self) -> dict[str, float]:
        """Values of the sliders by their labels."""
        session = self._page.session
        return {slider.label: value for slider, value in zip(session.live.sliders, session.design.values)}

    @property
    def words(self) -> str:
        """The shape in the words of ``move --deform``; empty if no words describe it."""
        return self._page.session.live.words(self._page.session.design)

    @property
    def control_points(self) -> np.ndarray:
        """Control points of the shape (m), shape (n_control_points, 3)."""
        return self._page.session.shape.control_points

    @property
    def grid(self) -> Grid:
        """The grid of the shape, with the names and patches of the baseline."""
        session = self._page.session
        session.complete()
        return session.live.model.with_nodes(session.shape.nodes)

    async def close(self) -> None:
        """Stop serving the page."""
        await self._page.server.stop()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.address}" width="100%" height="{self._height}" style="border: 0"></iframe>'
