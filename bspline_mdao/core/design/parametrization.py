"""Surface control points from design variables: successive maps, then the linear constraints.

With the maps ``M_k`` in the declared order and the elimination E of the constraints, surface control points s become
``s + E (M_n(... M_1(s, v_1) ..., v_n) - s)``. All derivatives are products of sparse matrices of constant pattern.
Theory: ``docs/theory/parametrization.rst`` and ``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array, vstack

from ...base.checks import require_list
from ...base.display import OneLine
from ...base.text import value_name
from ...errors import InputError
from ...names import ALL_NAMES
from ..mesh.moving_mesh import MovingMesh, require_mesh
from .elimination import Elimination, eliminate
from .hinge import Hinge
from .junction import Junction, SlidingJunction
from .section_maps import order_notes
from .variable import AuxiliaryPoints, DesignMap, Layout, MapPartials, Variable, ones_like

__all__ = ["Parametrization", "SurfacePartials"]

Values = Mapping[str, np.ndarray]
"""Values of the variables by name."""


@dataclass(frozen=True, eq=False)
class SurfacePartials(OneLine):
    """Derivatives of the surface control points, xyz interleaved."""

    initial: csr_array  # (3 n_surface, 3 n_surface), with respect to the surface control points of the baseline
    values: dict[str, csr_array]  # each (3 n_surface, n_values), with respect to the values of each variable
    # the same for the points of named hinges, with 6 rows
    hinges: dict[str, SurfacePartials] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Parametrization(OneLine):
    """Design variables of a surface and the linear constraints among its control points.

    Parameters
    ----------
    mesh : MovingMesh
        The control mesh with the design surface.
    variables : sequence of Variable
        Applied in this order.
    constraints : sequence of LinearConstraint
        Handled by elimination. The symmetry planes of the mesh are always kept.
    junction : Junction, optional
        Where a wing slides on a body: applied after the variables, except the ones the junction names as the body's.

    Raises
    ------
    InputError
        If a variable's name occurs twice or is taken, a variable does not fit the surface, a constraint cannot be
        satisfied, or the constraints leave a value of a variable without effect.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import Local, OnSideOfPlane, Parametrization
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> shape = Parametrization(mesh, [Local("bumps", OnSideOfPlane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), "y")])
    >>> values = {name: value + 0.01 for name, value in shape.initial.items()}
    >>> moved = shape.apply(mesh.points[mesh.surface_ids], values)
    >>> np.abs(moved - mesh.points[mesh.surface_ids]).max(axis=0).round(6)
    array([0.  , 0.01, 0.  ])
    """

    mesh: MovingMesh
    variables: Sequence[Variable]
    constraints: Sequence = ()
    junction: Junction | None = None

    def __post_init__(self) -> None:
        require_list(self.variables, "variable", ("name", "units", "auxiliary", "bind"), "parametrization")
        require_list(self.constraints, "linear constraint", ("name", "equations"), "parametrization")
        require_mesh(self.mesh, "parametrization")
        self._require_names()
        self._require_effect()

    def _require_names(self) -> None:
        """Refuse names that are taken."""
        names = [variable.name for variable in self.variables]
        twice = [name for n, name in enumerate(names) if name in names[:n]]
        if twice:
            raise InputError(f"parametrization: two variables are called '{twice[0]}'; give each its own name")
        taken = [name for name in names if not name or name in ALL_NAMES]
        if taken:
            raise InputError(f"parametrization: a variable is called '{taken[0]}', which is taken; choose another name")
        unknown = [name for name in (self.junction.shape if self.junction else ()) if name not in names]
        if unknown:
            raise InputError(
                f"parametrization: the junction names '{unknown[0]}' as a variable of the body's shape; there are "
                f"{', '.join(names)}"
            )
        hinges = [hinge.name for hinge in self._named]
        taken = [name for n, name in enumerate(hinges) if name in (*names, *ALL_NAMES, *hinges[:n])]
        if taken:
            raise InputError(f"parametrization: a hinge is called '{taken[0]}', as something else is; choose another")

    @cached_property
    def layout(self) -> Layout:
        """The rows moved by the variables."""
        auxiliary: list[AuxiliaryPoints] = []
        for item in (item for variable in self.variables for item in variable.auxiliary):
            if not any(item is other for other in auxiliary):
                auxiliary.append(item)
        return Layout(self.mesh, tuple(auxiliary))

    @property
    def _named(self) -> list[Hinge]:
        """The hinges that have names."""
        return [item for item in self.layout.auxiliary if isinstance(item, Hinge) and item.name]

    @cached_property
    def hinges(self) -> dict[str, slice]:
        """Rows of the points of named hinges."""
        return {hinge.name: self.layout.rows(hinge) for hinge in self._named}

    @cached_property
    def maps(self) -> dict[str, DesignMap]:
        """Every variable bound to the rows."""
        return {variable.name: variable.bind(self.layout) for variable in self.variables}

    @cached_property
    def _sliding(self) -> SlidingJunction | None:
        """The junction bound to the rows."""
        return None if self.junction is None else self.junction.bind(self.layout)

    @cached_property
    def _steps(self) -> tuple[tuple[str, DesignMap], ...]:
        """Maps in order of application, by the names of their variables; the junction's map has none."""
        sliding = self._sliding
        if sliding is None:
            return tuple(self.maps.items())
        shape = self.junction.shape if self.junction is not None else ()
        before = [item for item in self.maps.items() if item[0] not in shape]
        after = [(name, sliding.shaped(self.maps[name])) for name in self.maps if name in shape]
        return (*before, ("", sliding), *after)

    @cached_property
    def elimination(self) -> Elimination:
        """The constraints on the displacements of the surface control points."""
        return eliminate(self.mesh, self.layout.points[self.layout.rows()], self.constraints)

    @property
    def initial(self) -> dict[str, np.ndarray]:
        """Values at which nothing moves."""
        return {name: design_map.initial for name, design_map in self.maps.items()}

    @cached_property
    def pattern(self) -> SurfacePartials:
        """Ones wherever a derivative may differ from zero."""
        surface, matrix = self.layout.points[self.layout.rows()], ones_like(self._matrix)
        steps = [
            MapPartials(ones_like(step.points), ones_like(step.values))
            for step in self._partials(surface, self.initial)
        ]
        return self._chain(steps, matrix, self._identity + matrix)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the order of the variables, such as a scaling that changes angles made before it."""
        return order_notes(self.variables)

    def apply(self, initial: np.ndarray, values: Values) -> np.ndarray:
        """Move the surface control points.

        Parameters
        ----------
        initial : ndarray, shape (n_surface, 3)
            Baseline surface control points (m); real or complex.
        values : mapping of ndarray
            Values of every variable by name.

        Returns
        -------
        ndarray, shape (n_surface, 3)
            Moved surface control points (m).

        Raises
        ------
        InputError
            If points or values are missing, too many or too few.
        """
        rows, initial = self._moved(initial, values), np.asarray(initial)
        displacement = rows[: len(initial)] - initial
        return initial + (self._matrix @ displacement.reshape(-1)).reshape(-1, 3)

    def hinge_points(self, initial: np.ndarray, values: Values) -> dict[str, np.ndarray]:
        """Move the named hinges.

        Parameters
        ----------
        initial, values
            As for `apply`.

        Returns
        -------
        dict of ndarray, shape (2, 3)
            Both points of each (m), by its name.

        Raises
        ------
        InputError
            As `apply`.
        """
        rows = self._moved(initial, values)
        return {name: rows[of_hinge] for name, of_hinge in self.hinges.items()}

    def _moved(self, initial: np.ndarray, values: Values) -> np.ndarray:
        """Move all rows by the variables and the junction."""
        initial, values = self._checked(initial, values)
        rows = self._rows(initial)
        for name, design_map in self._steps:
            rows = design_map.apply(rows, values.get(name, design_map.initial))
        return rows

    def extremes(self, bounds: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Iterator[np.ndarray]:
        """Move the baseline to the most extreme designs, for `increments_for`.

        For each variable in turn, all its values are at their lower bounds, or at their upper ones, while nothing else
        moves; then all variables together are.

        Parameters
        ----------
        bounds : mapping of (array_like, array_like)
            Lower and upper bound of variables by name, in the variable's units: one number, or one for each value. An
            omitted variable does not move.

        Yields
        ------
        ndarray, shape (n_surface, 3)
            Moved surface control points (m).

        Raises
        ------
        InputError
            If there is no such variable, or bounds do not match its values.

        Examples
        --------
        >>> from bspline_mdao import DesignSurface, fit_grid
        >>> from bspline_mdao.design import Twist
        >>> from bspline_mdao.generators import flat_plate_grid
        >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
        >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
        >>> len(list(shape.extremes({"twist": ([0.0, -5.0], [0.0, 5.0])})))  # degrees
        2
        """
        surface = self.mesh.points[self.mesh.surface_ids]
        for end in (0, 1):
            at_bounds = {name: self._at_bound(name, pair[end]) for name, pair in bounds.items()}
            for name, values in at_bounds.items():
                yield self.apply(surface, {**self.initial, name: values})
            if len(at_bounds) > 1:
                yield self.apply(surface, {**self.initial, **at_bounds})

    def _at_bound(self, name: str, bound: ArrayLike) -> np.ndarray:
        """Values of a variable at a bound, possibly one number for all."""
        if name not in self.initial:
            raise InputError(f"parametrization: no variable is called '{name}'; there are {', '.join(self.maps)}")
        values, shape = np.asarray(bound, dtype=float), self.initial[name].shape
        if values.shape not in ((), shape):
            raise InputError(
                f"parametrization: the bounds of '{name}' are of shape {values.shape}; give a number, or shape {shape}"
            )
        return np.broadcast_to(values, shape)

    def partials(self, initial: np.ndarray, values: Values) -> SurfacePartials:
        """Differentiate `apply`.

        Parameters
        ----------
        initial, values
            As for `apply`, real.

        Returns
        -------
        SurfacePartials
            Derivatives within `pattern`.

        Raises
        ------
        InputError
            As `apply`.
        """
        initial, values = self._checked(initial, values)
        return self._chain(self._partials(initial, values), self._matrix, self._identity - self._matrix)

    def _checked(self, initial: ArrayLike, values: Mapping[str, ArrayLike]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Points and values as arrays of the right shapes."""
        shape = (self.layout.n_surface, 3)
        if np.shape(initial) != shape:
            raise InputError(f"parametrization: initial points of shape {np.shape(initial)}; give shape {shape}")
        unknown = sorted(set(values) - set(self.maps))
        if unknown:
            raise InputError(f"parametrization: no variable is called '{unknown[0]}'; there are {', '.join(self.maps)}")
        for name, expected in self.initial.items():
            if name not in values or np.shape(values[name]) != expected.shape:
                found = f"of shape {np.shape(values[name])}" if name in values else "missing"
                raise InputError(f"parametrization: the values of '{name}' are {found}; give shape {expected.shape}")
        return np.asarray(initial), {name: np.asarray(value) for name, value in values.items()}

    @property
    def _matrix(self) -> csr_array:
        return self.elimination.matrix

    @property
    def _identity(self) -> csr_array:
        return eye_array(3 * self.layout.n_surface, format="csr")

    def _rows(self, surface: np.ndarray) -> np.ndarray:
        """All rows: the surface, and the auxiliary points on the baseline."""
        return np.concatenate([surface, self.layout.points[self.layout.n_surface :]])

    def _partials(self, surface: np.ndarray, values: Mapping[str, np.ndarray]) -> Iterator[MapPartials]:
        """Derivatives of every map at its point in the chain."""
        rows = self._rows(surface)
        for name, design_map in self._steps:
            amounts = values.get(name, design_map.initial)
            yield design_map.partials(rows, amounts)
            rows = design_map.apply(rows, amounts)

    def _chain(self, steps: Iterable[MapPartials], matrix: csr_array, rest: csr_array) -> SurfacePartials:
        """Multiply the derivatives of all maps and of the elimination; ``rest`` is the identity minus the latter."""
        n = 3 * self.layout.n_surface
        zeros = csr_array((3 * len(self.layout.points) - n, n))  # auxiliary points do not depend on the surface
        initial = vstack([self._identity, zeros], format="csr")
        values: list[csr_array] = []
        for step in steps:
            initial, values = step.points @ initial, [step.points @ value for value in values] + [step.values]
        found = {name: value for (name, _), value in zip(self._steps, values)}
        by_name, hinges = {name: found[name] for name in self.maps}, {}
        for name, rows in self.hinges.items():
            of_hinge = slice(3 * rows.start, 3 * rows.stop)
            by_values = {of: part[of_hinge] for of, part in by_name.items()}
            hinges[name] = SurfacePartials(initial[of_hinge], by_values)
        of_values = {name: matrix @ value[:n] for name, value in by_name.items()}
        return SurfacePartials(rest + matrix @ initial[:n], of_values, hinges)

    def _require_effect(self) -> None:
        """Refuse values that move nothing."""
        for name, pattern in self.pattern.values.items():
            is_idle = np.diff(pattern.tocsc().indptr) == 0
            if is_idle.any():
                value = int(np.argmax(is_idle))
                reason = self._what_fixes(name, value) or "no point of the surface"
                idle = f"{value_name(name, value, len(is_idle))} moves nothing ({reason})"
                rest = np.count_nonzero(is_idle) - 1
                more = f", nor do {rest} more of its {len(is_idle)}" if rest else ""
                raise InputError(f"parametrization: {idle}{more}; select and direct it so as to leave them out")

    def _what_fixes(self, name: str, value: int) -> str:
        """The constraint that removes the effect of a value; empty if it never had one."""
        partials = self.maps[name].partials(self.layout.points, self.maps[name].initial)
        coordinates = partials.values.tocsc()[:, [value]].indices
        on_surface = coordinates[coordinates < 3 * self.layout.n_surface]
        return self.elimination.reason(on_surface[0]) if len(on_surface) else ""
