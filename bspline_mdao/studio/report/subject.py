"""What a page shows of a model, whatever its cells: blocks are in `.block_subject`, other meshes in `.mesh_subject`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import singledispatch

import numpy as np

from ...core.model.movable import Movable
from ...core.sliding.sliding_nodes import Slide, SlidingNodes
from ...errors import InputError
from .charts import Chart
from .shape import Axes, Shape
from .tables import Table
from .walls import WallHeights, Walls

__all__ = ["Judgement", "Layer", "Mark", "Subject", "WallQuality", "off_surfaces", "subject_of"]


@dataclass(frozen=True)
class Mark:
    """A place that is marked in space."""

    place: Sequence[float]  # (m)
    text: str


@dataclass(frozen=True)
class Layer:
    """Lines and points that are shown or hidden."""

    key: str  # a key of `.space.STYLES`
    lines: np.ndarray  # (n, 3), with gaps (m)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (m, 3) (m)


@dataclass(frozen=True, eq=False)
class WallQuality:
    """Quality of the cells behind wall faces."""

    name: str
    corners: np.ndarray  # (n, 4) of int, rows of the corners of the faces
    values: np.ndarray  # (n,)


@dataclass(frozen=True)
class Judgement:
    """The quality of the cells of all shapes."""

    card: tuple[str, str, str]  # key figure: what, how much, and a remark
    marks: Sequence[Sequence[Mark]]  # the worst cells of each shape
    charts: Sequence[Chart]
    tables: Sequence[Table]


class Subject(ABC):
    """What a page shows of a model."""

    source: str  # origin of the model
    space_title = "The grid"  # heading of the 3D view
    label = "Grid of the model"  # name of the shape of the model
    unit: str  # of lengths
    baseline_points: np.ndarray  # (n_control_points, 3), control points of the model (m)

    @property
    @abstractmethod
    def n_nodes(self) -> int:
        """Number of nodes."""

    @property
    def is_section(self) -> bool:
        """Whether its walls are a section, so a flow about it has no trailing vortices."""
        return False

    @property
    @abstractmethod
    def size(self) -> str:
        """Its size, in words."""

    @abstractmethod
    def nodes_at(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Nodes for control points (m), by default the model's, shape (n_nodes, 3)."""

    @property
    @abstractmethod
    def layers(self) -> dict[str, str]:
        """Names of the layers that can be shown or hidden, by their keys."""

    @property
    @abstractmethod
    def pressure_faces(self) -> np.ndarray | None:
        """Corners of the wall faces in the order of ``Cp``, shape (n, 4); None if there is no flow about them."""

    @abstractmethod
    def wall_quality(self, nodes: np.ndarray) -> WallQuality | None:
        """Quality of the cells at walls with nodes (m); None if these cells are unknown."""

    @property
    @abstractmethod
    def across_symmetry(self) -> int | None:
        """Axis normal to the largest plane of symmetry; None if there is none."""

    @property
    @abstractmethod
    def heights(self) -> WallHeights | None:
        """Heights of the first cells at walls; None if there are none."""

    @abstractmethod
    def walls(self, most_triangles: int) -> Walls:
        """Choose the drawn part of the walls, with at most about so many triangles."""

    @abstractmethod
    def layers_of(self, shape: Shape, walls: Walls) -> Iterator[Layer]:
        """Drawn layers of a shape besides its walls."""

    @abstractmethod
    def judge(self, shapes: Sequence[Shape]) -> Judgement:
        """Judge the cells."""

    @abstractmethod
    def misses(self, shapes: Sequence[Shape]) -> list[tuple[str, str, list[float]]]:
        """Gaps of periodic sides and of sliding nodes, see `interface_table`."""

    @abstractmethod
    def section_charts(self, shapes: Sequence[Shape], walls: Walls, axes: Axes) -> list[Chart]:
        """Charts of the cells around sections."""

    @property
    @abstractmethod
    def cards(self) -> list[tuple[str, str, str]]:
        """Key figures of the model: what, how much, and a remark."""

    @property
    @abstractmethod
    def contents(self) -> tuple[str, str, list[Table]]:
        """Key and title of the section that describes the model, and its tables."""


@singledispatch
def subject_of(model: Movable, slides: Sequence[Slide] = ()) -> Subject:
    """Make the page's view of a model; patches of its blocks may slide on surfaces."""
    raise InputError(f"report: nothing is known of a {type(model).__name__}; give a FittedModel or a MeshModel")


def off_surfaces(
    names: Iterable[str],  # what slides
    slides: Iterable[Slide],  # on what
    sliding: SlidingNodes,
    shapes: Sequence[Shape],
) -> tuple[str, str, list[float]]:
    """Distances of nodes of shapes from the surfaces on which they slide, see `Subject.misses`."""
    surfaces = ", ".join(dict.fromkeys(str(slide.surface) for slide in slides))
    return f"nodes of {', '.join(names)}", f"sliding on {surfaces}", [sliding.off(shape.nodes) for shape in shapes]
