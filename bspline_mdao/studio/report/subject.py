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

    key: str  # one of those of `.space.STYLES`
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
    """What the cells of all shapes are like."""

    card: tuple[str, str, str]  # key figure: what, how much, and a remark
    marks: Sequence[Sequence[Mark]]  # the worst cells of each shape
    charts: Sequence[Chart]
    tables: Sequence[Table]


class Subject(ABC):
    """What a page shows of a model."""

    source: str  # where the model comes from
    space_title = "The grid"  # heading of the drawing in space
    label = "Grid of the model"  # what the shape of the model is called
    unit: str  # of lengths
    baseline_points: np.ndarray  # (n_control_points, 3), control points of the model (m)

    @property
    @abstractmethod
    def n_nodes(self) -> int:
        """Number of nodes."""

    @property
    def is_section(self) -> bool:
        """Whether its walls are a section, the flow about which has no trailing vortices."""
        return False

    @property
    @abstractmethod
    def size(self) -> str:
        """How large it is, in words."""

    @abstractmethod
    def nodes_at(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Nodes for control points (m), those of the model by default, shape (n_nodes, 3)."""

    @property
    @abstractmethod
    def layers(self) -> dict[str, str]:
        """Names of what can be shown or hidden, by their keys."""

    @property
    @abstractmethod
    def pressure_faces(self) -> np.ndarray | None:
        """Corners of the wall faces in the order of ``Cp``, shape (n, 4); None where there is no flow about them."""

    @abstractmethod
    def wall_quality(self, nodes: np.ndarray) -> WallQuality | None:
        """Quality of the cells at walls with nodes (m); None where it is not known which these are."""

    @property
    @abstractmethod
    def across_symmetry(self) -> int | None:
        """Axis across the largest plane of symmetry; None where there is none."""

    @property
    @abstractmethod
    def heights(self) -> WallHeights | None:
        """Heights of the first cells at walls; None where there are none."""

    @abstractmethod
    def walls(self, most_triangles: int) -> Walls:
        """Choose what is drawn of the walls, with at most about so many triangles."""

    @abstractmethod
    def layers_of(self, shape: Shape, walls: Walls) -> Iterator[Layer]:
        """What is drawn of a shape besides its walls."""

    @abstractmethod
    def judge(self, shapes: Sequence[Shape]) -> Judgement:
        """Judge the cells."""

    @abstractmethod
    def misses(self, shapes: Sequence[Shape]) -> list[tuple[str, str, list[float]]]:
        """By how much periodic sides, and nodes that slide, are off, see `interface_table`."""

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
        """Key and title of the section that says what the model is, and its tables."""


@singledispatch
def subject_of(model: Movable, slides: Sequence[Slide] = ()) -> Subject:
    """Take what a page shows of a model, patches of whose blocks may slide on surfaces."""
    raise InputError(f"report: nothing is known of a {type(model).__name__}; give a FittedModel or a MeshModel")


def off_surfaces(
    names: Iterable[str],  # what slides
    slides: Iterable[Slide],  # on what
    sliding: SlidingNodes,
    shapes: Sequence[Shape],
) -> tuple[str, str, list[float]]:
    """How far nodes of shapes are from the surfaces that they slide on, see `Subject.misses`."""
    surfaces = ", ".join(dict.fromkeys(str(slide.surface) for slide in slides))
    return f"nodes of {', '.join(names)}", f"sliding on {surfaces}", [sliding.off(shape.nodes) for shape in shapes]
