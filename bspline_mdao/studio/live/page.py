"""The page on which a model is deformed: trame serves it, and the browser draws what VTK's objects describe.

Events that change the shape only record the request. One task makes the shapes, the newest first, so a slider that is
faster than the shapes skips some. While the mouse moves only the visible part is made; the rest, and the flow, follow
when it rests.
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Callable
from secrets import token_urlsafe
from typing import Any

import numpy as np

from ...base.extras import library
from .scene import COLOURS, Camera, Scene, View
from .session import Session

__all__ = ["LOOPBACK", "Page", "require_trame"]

LOOPBACK = "127.0.0.1"
"""Address that only this machine reaches."""

_NEED = "the command live needs trame and VTK"

RESTS = 0.25
"""Time (s) without a change after which the whole grid is made and the flow is solved."""

_FILES = {"report": ".html", "STEP": ".step", "PLOT3D": ".xyz", "study.toml": ".toml", "points": ".csv"}
"""Buttons that write, and the suffixes of their files."""

_DIRECTIONS = ("none", "i", "j", "k")
_REACH = 0.25
"""Largest displacement of a control point along an axis, relative to the size of the surface."""

_AXES = ("x", "y", "z")

_OF_CAMERA = "'position', 'focalPoint', 'viewUp', 'viewAngle'"
"""Properties of the browser's camera that are read."""


def require_trame() -> None:
    """Import what a page needs; `InputError` with the install command if something is missing."""
    for module in ("trame.app", "trame.ui.vuetify3", "trame.widgets.vuetify3", "trame.widgets.vtk"):
        library(module, _NEED, "live")


class Page:
    """The page of a session; ``name`` is the server's, unique in a process."""

    def __init__(self, session: Session, name: str = "bspline_mdao live") -> None:
        require_trame()
        self.session, self.scene = session, Scene(session.live)
        session.live.warm(self.scene.part(View()))
        self.server = library("trame.app", _NEED, "live").get_server(name)
        self.server.client_type = "vue3"
        self.state, self.ctrl = self.server.state, self.server.controller
        self._is_asked = False
        self._task: asyncio.Task[None] | None = None
        self.camera = self.scene.camera
        self._grip: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # pixel, displacement, place at the start
        self.reach = float(f"{_REACH * session.live.surface.size:.2g}")
        self._declare()
        self.view: Any = None
        self.ui = self._lay_out()
        self.show()

    def _declare(self) -> None:
        """Declare the state that the browser and the server share."""
        live = self.session.live
        for number, value in enumerate(self.session.design.values):
            self.state[f"slider_{number}"] = value
        for axis in _AXES:
            self.state[f"pull_{axis}"] = 0.0
        self.state.update(
            {
                "trame__title": f"bspline_mdao live: {live.model.header.source}",
                "colour": "quality",
                "colours": [{"title": label, "value": name} for name, (label, _) in COLOURS.items()],
                "has_points": True,
                "has_symmetry": False,
                "is_pulling": False,
                "direction": "none",
                "part": 0.5,
                "picked": None,
                "message": "",
            }
        )
        sliders = [f"slider_{number}" for number in range(len(live.sliders))]
        if sliders:
            self.state.change(*sliders)(self._sliders_changed)
        self.state.change(*(f"pull_{axis}" for axis in _AXES))(self._pull_changed)
        self.state.change("colour", "has_points", "has_symmetry", "direction", "part")(self._view_changed)

    @property
    def seen(self) -> View:
        """The view that is selected."""
        state = self.state
        direction = None if state.direction == "none" else _DIRECTIONS.index(state.direction) - 1
        return View(state.colour, bool(state.has_points), bool(state.has_symmetry), direction, float(state.part))

    def show(self) -> None:
        """Show the current shape."""
        session, state = self.session, self.state
        low, high = self.scene.show(session.shape, self.seen)
        self.scene.pick(session.picked)
        state.ends = [f"{low:.3g}", f"{high:.3g}"]
        self._show_numbers()
        if self.view is not None:
            self.view.update()

    def _show_numbers(self) -> None:
        session, state = self.session, self.state
        state.update(
            {
                "numbers": session.numbers(),
                "worst": session.worst_cells(),
                "warning": session.complaint or session.warning,
                "command": session.command,
                "can_undo": bool(session.history.before),
                "can_redo": bool(session.history.after),
                "is_part": session.shape.part is not None,
                "milliseconds": round(1e3 * sum(session.shape.seconds.values())),
            }
        )

    def _sliders_changed(self, **_: Any) -> None:
        for number, slider in enumerate(self.session.live.sliders):
            value = self.state[f"slider_{number}"]
            if value != self.session.design.values[number]:
                self.session.set(number, slider.neutral if value is None else value)
        self.ask()

    def _pull_changed(self, **_: Any) -> None:
        x, y, z = (float(self.state[f"pull_{axis}"] or 0.0) for axis in _AXES)
        if self.session.picked is not None and (x, y, z) != self.session.displacement:
            self.session.pull((x, y, z))
            self.ask()

    def _view_changed(self, **_: Any) -> None:
        if self.view is not None:
            self.session.complete()  # the part may lack what is visible now
            self.show()

    def ask(self) -> None:
        """Request the shape of the current design, once for all requests until its turn comes."""
        if self.session.design == self.session.shape.design and not self.session.complaint:
            return
        self._is_asked = True
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._follow())

    async def _follow(self) -> None:
        """Make the visible part of shapes as long as some are requested, and then all of the last one."""
        while self._is_asked:
            self._is_asked = False
            self.session.update(self.scene.part(self.seen))
            with self.state:
                self.show()
            await asyncio.sleep(0.0)  # messages that the browser has sent meanwhile come first
            if not self._is_asked:
                await asyncio.sleep(RESTS)
                if not self._is_asked and not self.session.complaint:
                    self.session.complete()
                    with self.state:
                        self.show()

    def _put_state(self) -> None:
        """Set the sliders to the current design."""
        for number, value in enumerate(self.session.design.values):
            self.state[f"slider_{number}"] = value
        self.state.picked = None if self.session.picked is None else self.session.picked + 1
        for axis, value in zip(_AXES, self.session.displacement):
            self.state[f"pull_{axis}"] = value

    def settle(self, *_: Any) -> None:
        """End a step, when a slider is released."""
        self.session.history.settle()

    def undo(self) -> None:
        """Go one step back."""
        self.session.history.undo()
        self._put_state()
        self.ask()

    def redo(self) -> None:
        """Redo the last step."""
        self.session.history.redo()
        self._put_state()
        self.ask()

    def reset(self) -> None:
        """Return to the model."""
        self.session.reset()
        self._put_state()
        self.ask()

    def write(self, suffix: str) -> None:
        """Write the current shape."""
        self.state.message = self.session.write(suffix)

    def look(self, camera: Any = None, *_: Any) -> None:
        """Note where the browser looks from."""
        if isinstance(camera, dict) and "position" in camera:
            position, focal_point, up = (
                np.array(camera[name], dtype=float) for name in ("position", "focalPoint", "viewUp")
            )
            self.camera = Camera(position, focal_point, up, float(camera.get("viewAngle", self.camera.angle)))

    def press(self, x: float, y: float, width: float, height: float) -> None:
        """Select the control point at a pixel of the drawing."""
        pixel, shape = np.array([x, y], dtype=float), (float(width), float(height))
        self.pick(self.scene.nearest(self.camera, pixel, shape))
        self._grip = None
        if self.session.picked is not None:
            self._grip = pixel, np.array(self.session.displacement), self.scene.surface[self.session.picked].copy()

    def drag(self, x: float, y: float, width: float, height: float) -> None:
        """Pull the selected control point to a pixel, across the line of sight."""
        if self._grip is None:
            return
        pixel, before, place = self._grip
        moved = np.array([x, y], dtype=float) - pixel
        there = before + self.camera.displacement(place, moved, (float(width), float(height)))
        there = np.clip(there, -self.reach, self.reach)
        self.session.pull((there[0], there[1], there[2]))
        self._put_state()
        self.ask()

    def release(self, *_: Any) -> None:
        """Release the control point."""
        self._grip = None
        self.settle()

    def pick(self, row: int | None) -> None:
        """Select a control point of the surface by its row."""
        self.session.history.settle()
        self.session.picked = row
        self._put_state()
        self.scene.pick(row)
        self.view.update()

    def pick_number(self, number: Any) -> None:
        """Select a control point of the surface by its number, from 1; none if it is no such number."""
        text = str(number or "")
        row = int(text) - 1 if text.isdigit() else -1
        self.pick(row if 0 <= row < len(self.session.live.mesh.surface_ids) else None)

    def nudge(self, steps: float) -> None:
        """Pull the selected control point along its normal."""
        self.session.nudge(steps * 0.01 * self.reach)
        self.session.history.settle()
        self._put_state()
        self.ask()

    def _lay_out(self) -> Any:
        """Lay out the page."""
        v3 = library("trame.widgets.vuetify3", _NEED, "live")
        html = library("trame.widgets.html", _NEED, "live")
        vtk = library("trame.widgets.vtk", _NEED, "live")
        layouts = library("trame.ui.vuetify3", _NEED, "live")
        with layouts.VAppLayout(self.server, full_height=True) as layout:
            with v3.VAppBar(density="compact", flat=True, border=True):
                v3.VAppBarTitle("{{ trame__title }}", style="font-size: 1rem")
                self._buttons(v3)
            with v3.VNavigationDrawer(permanent=True, width=330):
                self._sliders(v3, html)
            with v3.VNavigationDrawer(permanent=True, width=330, location="right"):
                self._numbers(v3, html)
            with v3.VMain(), html.Div(style="position: relative; height: 100%; width: 100%"):
                self.view = vtk.VtkLocalView(
                    self.scene.window,
                    ref="view",
                    interactor_events=("['EndAnimation']",),
                    EndAnimation=(self.look, f"[$event.pokedRenderer.getActiveCamera().get({_OF_CAMERA})]"),
                )
                self._handle(html)
                self._legend(v3, html)
        return layout

    def _buttons(self, v3: Any) -> None:
        look = {"size": "small", "variant": "text"}
        v3.VBtn("undo", id="undo", click=self.undo, disabled=("!can_undo",), **look)
        v3.VBtn("redo", id="redo", click=self.redo, disabled=("!can_redo",), **look)
        v3.VBtn("reset", id="reset", click=self.reset, **look)
        v3.VDivider(vertical=True, classes="mx-2")
        for label, suffix in _FILES.items():
            call = (self.write, f"['{suffix}']")
            v3.VBtn(label, id=f"write-{suffix[1:]}", click=call, size="small", variant="tonal", classes="mr-1")

    def _sliders(self, v3: Any, html: Any) -> None:
        with v3.VContainer(classes="py-2"):
            html.Div("Variables", classes="text-subtitle-2")
            for number, slider in enumerate(self.session.live.sliders):
                name, unit = f"slider_{number}", slider.unit and f" {slider.unit}"
                self._slider(v3, html, name, slider.label, (slider.low, slider.high, slider.step), unit)
            html.Div("Control point", classes="text-subtitle-2 mt-3")
            look = {"density": "compact", "hide_details": True, "color": "primary"}
            v3.VSwitch(v_model=("is_pulling",), label="drag with the mouse", id="is_pulling", **look)
            with html.Div(classes="d-flex align-center"):
                v3.VTextField(
                    model_value=("picked",),
                    update_modelValue=(self.pick_number, "[$event]"),
                    id="picked",
                    label="number",
                    density="compact",
                    variant="outlined",
                    hide_details=True,
                    classes="my-2",
                )
                for label, steps in (("in", -1.0), ("out", 1.0)):
                    call = (self.nudge, f"[{steps}]")
                    shape = {"disabled": ("picked === null",), "size": "small", "variant": "tonal", "classes": "ml-1"}
                    v3.VBtn(label, id=f"nudge-{label}", click=call, **shape)
            with html.Div(v_if=("picked !== null",)):
                for axis in _AXES:
                    ends = (-self.reach, self.reach, self.reach / 1000.0)
                    self._slider(v3, html, f"pull_{axis}", f"along {axis}", ends, f" {self.unit}")

    @property
    def unit(self) -> str:
        """Unit of length of the model."""
        return self.session.live.model.header.length_unit

    def _slider(self, v3: Any, html: Any, name: str, label: str, ends: tuple[float, float, float], unit: str) -> None:
        low, high, step = ends
        digits = max(2, math.ceil(-math.log10(step) - 0.01))
        with html.Div(classes="d-flex justify-space-between text-caption"):
            html.Span(label)
            html.Span(f"{{{{ Number({name}).toFixed({digits}) }}}}{unit}")
        v3.VSlider(
            v_model=(name,),
            id=name,
            min=low,
            max=high,
            step=step,
            end=self.settle,
            density="compact",
            hide_details=True,
            color="primary",
        )

    def _numbers(self, v3: Any, html: Any) -> None:
        said = "mb-2 text-caption"
        with v3.VContainer(classes="py-2"):
            v3.VAlert(
                "{{ warning }}",
                v_if=("warning",),
                id="warning",
                type="error",
                density="compact",
                classes="mb-2 text-caption",
            )
            v3.VAlert("{{ message }}", v_if=("message",), id="message", density="compact", classes=said)
            with v3.VTable(density="compact", id="numbers", classes="text-caption"):
                with html.Thead(), html.Tr():
                    html.Th("")
                    html.Th("now")
                    html.Th("before")
                with html.Tbody(), html.Tr(v_for="row in numbers", key="row.name"):
                    html.Td("{{ row.name }}", classes="px-1")
                    html.Td("{{ row.value }}", classes=("row.is_bad ? 'px-1 text-red font-weight-bold' : 'px-1'",))
                    html.Td("{{ row.was }}", classes="px-1 text-medium-emphasis")
            html.Div("visible cells only; all cells in a moment", v_if=("is_part",), classes="text-caption")
            html.Div("Worst cells, by their smallest corner", classes="text-subtitle-2 mt-3")
            html.Div("{{ cell }}", v_for="cell in worst", key="cell", classes="text-caption")
            html.Div("{{ command }}", id="command", classes="text-caption mt-3", style="font-family: monospace")
            html.Div("{{ milliseconds }} ms of this machine", classes="text-caption text-medium-emphasis mt-1")
            html.Div("Seen", classes="text-subtitle-2 mt-3")
            look: dict[str, Any] = {"density": "compact", "hide_details": True}
            v3.VSelect(v_model=("colour",), items=("colours",), id="colour", variant="outlined", **look)
            v3.VCheckbox(v_model=("has_points",), label="control points", id="has_points", **look)
            v3.VCheckbox(v_model=("has_symmetry",), label="planes of symmetry", id="has_symmetry", **look)
            items = (f"{list(_DIRECTIONS)}",)
            v3.VSelect(v_model=("direction",), items=items, label="grid planes off the walls", **look)
            v3.VSlider(v_model=("part",), v_if=("direction !== 'none'",), min=0.0, max=1.0, step=0.02, **look)

    def _handle(self, html: Any) -> None:
        """The sheet over the drawing that catches the mouse."""
        for name in ("press", "drag", "release"):
            self.server.trigger(name)(getattr(self, name))
        at = "[$event.offsetX, $event.offsetY, $event.target.clientWidth, $event.target.clientHeight]"
        html.Div(
            v_if=("is_pulling",),
            id="sheet",
            style="position: absolute; inset: 0; cursor: crosshair",
            mousedown=f"trigger('press', {at})",
            mousemove=f"$event.buttons === 1 && trigger('drag', {at})",
            mouseup="trigger('release')",
            mouseleave="trigger('release')",
        )

    def _legend(self, v3: Any, html: Any) -> None:
        stops = ("#b2182b, #f4a582, #f7f7f7, #92c5de, #2166ac", "#440154, #3b528b, #21918c, #5ec962, #fde725")
        ratio, other = (f"linear-gradient(to right, {colours})" for colours in stops)
        style = "position: absolute; left: 16px; bottom: 12px; width: 260px; pointer-events: none"
        with html.Div(style=style, classes="text-caption"):
            html.Div("{{ colours.find(each => each.value === colour).title }}")
            bar = f"{{ height: '10px', background: colour === 'heights' ? '{ratio}' : '{other}' }}"
            html.Div(style=(bar,))
            with html.Div(classes="d-flex justify-space-between"):
                html.Span("{{ ends[0] }}")
                html.Span("{{ ends[1] }}")

    def on_ready(self, say: Callable[[int], None]) -> None:
        """Call a function with the port once the page can be opened."""
        self.ctrl.on_server_ready.add(lambda **_: say(self.server.port))

    def serve(self, host: str = LOOPBACK, port: int = 0, has_browser: bool = True, **settings: Any) -> Any:
        """Serve the page until it is interrupted; settings are as in trame's server."""
        secret = token_urlsafe(24)
        arguments, sys.argv = sys.argv, [sys.argv[0], f"--authKey={secret}"]  # trame reads them
        try:
            _answer_session(self.server, secret, host == LOOPBACK)
            return self.server.start(
                host=host, port=port, open_browser=has_browser, show_connection_info=False, timeout=0, **settings
            )
        finally:
            sys.argv = arguments


def _answer_session(server: Any, secret: str, is_local: bool) -> None:
    """Answer the request for a session with which trame's page begins, by the secret of its socket.

    Other pages that are open in the browser can reach this address too, but they cannot read the answer and so do not
    learn the secret; nor do pages that reach it by a host name of their own.
    """
    web = library("aiohttp.web", _NEED, "live")

    async def answer(request: Any) -> Any:
        if is_local and request.url.host not in (LOOPBACK, "localhost"):
            raise web.HTTPForbidden()
        return web.json_response({"sessionURL": f"ws://{request.host}/ws", "secret": secret})

    server.controller.on_server_bind.add(lambda bound: bound.app.router.add_post("/paraview/", answer))
