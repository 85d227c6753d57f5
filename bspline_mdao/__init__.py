"""B-spline meshes as integrated geometry parametrization and grid movement for OpenMDAO."""

from importlib import import_module

from .kernel_cache import ensure_kernel_cache

__version__ = "0.1.0"

ensure_kernel_cache()

_HOMES = {
    "Beyond": "parametrization.selection",
    "BilinearKnots": "splines.knots",
    "Camber": "parametrization.planform",
    "CamberSurface": "geometry.camber_surface",
    "Chord": "parametrization.planform",
    "Clearance": "geometry.clearance",
    "Collinear": "parametrization.collinear",
    "ConjugateGradients": "sparse.conjugate_gradient",
    "ConstantKnots": "splines.knots",
    "ControlMeshMove": "components.control_mesh_move",
    "Curvature": "geometry.curvature",
    "DelaunayGraph": "movement.delaunay",
    "Dihedral": "parametrization.planform",
    "EnclosedVolume": "geometry.volume",
    "EulerBuilder": "mphys.builders",
    "EulerFlow": "flow.euler_flow",
    "Fit": "components.fit",
    "FitWarning": "errors",
    "FittedModel": "model",
    "FlowBuilder": "mphys.builders",
    "FreeForm": "parametrization.free_form",
    "FunctionKnots": "splines.knots",
    "GeometryBuilder": "mphys.builders",
    "Grid": "grids.multiblock",
    "GridEvaluate": "components.grid_evaluate",
    "GridMovement": "components.grid_movement",
    "Held": "movement.held",
    "InBlock": "parametrization.selection",
    "InBox": "parametrization.selection",
    "InPlane": "parametrization.linear_constraints",
    "InputError": "errors",
    "InverseDistance": "movement.inverse_distance",
    "Lattice": "parametrization.lattice",
    "LatticeFlow": "flow.lattice_flow",
    "LeadingEdgeRadius": "geometry.leading_edge",
    "LinealSprings": "movement.springs",
    "LinearElasticity": "movement.elasticity",
    "Linked": "parametrization.linear_constraints",
    "LiveGridEvaluate": "components.live_grid_evaluate",
    "Local": "parametrization.local",
    "Mirrored": "parametrization.mirrored",
    "Monotonic": "components.monotonic",
    "MovementError": "errors",
    "NLoptDriver": "drivers.nlopt_driver",
    "NearPlane": "parametrization.selection",
    "Nearest": "parametrization.selection",
    "OnPatch": "parametrization.selection",
    "Opposite": "parametrization.linear_constraints",
    "Parametrization": "parametrization.composition",
    "Pinned": "parametrization.linear_constraints",
    "PlaneClearance": "geometry.plane_clearance",
    "ProjectedArea": "geometry.area",
    "Quality": "components.quality",
    "RadialBasis": "movement.radial_basis",
    "ReferenceAxis": "parametrization.axis",
    "SectionThickness": "geometry.sections",
    "Span": "parametrization.planform",
    "SurfaceArea": "geometry.area",
    "SurfaceControl": "components.surface_control",
    "SurfaceControlFit": "components.surface_control_fit",
    "SurfaceEvaluate": "components.surface_evaluate",
    "SurfaceGeometry": "mphys.geometry",
    "SurfaceGrid": "geometry.surface",
    "SurfaceMeasure": "components.surface_measure",
    "SurfaceRows": "parametrization.selection",
    "Sweep": "parametrization.planform",
    "Taper": "parametrization.planform",
    "Thickness": "geometry.thickness",
    "ThicknessFactor": "parametrization.planform",
    "Together": "parametrization.linear_constraints",
    "TorsionalSprings": "movement.springs",
    "TrailingEdgeAngle": "geometry.trailing_edge",
    "Transfinite": "movement.transfinite",
    "Twist": "parametrization.planform",
    "UnsteadyGrid": "motion",
    "UserVariable": "parametrization.user_defined",
    "VolumeWarper": "mphys.warper",
    "VortexLattice": "flow.vortex_lattice",
    "check_variable": "parametrization.checks",
    "family_member": "model",
    "find_topology": "grids.topology",
    "fit_grid": "fit.fitting",
    "fit_shape": "generators.targets",
    "flapping": "motion",
    "flat_plate_grid": "generators.canonical",
    "generic_blended_wing_body": "generators.blended_wing_body",
    "invert_points": "evaluation.inversion",
    "moving_grid": "movement.boundary",
    "moving_mesh": "movement.boundary",
    "onera_m6_grid": "generators.canonical",
    "parse_deformation": "deformations.named",
    "pitching": "motion",
    "read_grid": "grids.files",
    "rectangular_wing": "generators.canonical",
    "require_inside": "evaluation.inversion",
    "ride": "evaluation.inversion",
    "write_grid": "grids.files",
    "write_polymesh": "grids.openfoam",
    "write_vtk": "grids.vtk",
}

__all__ = list(_HOMES)


def __getattr__(name: str):
    """Import a public name when it is first asked for (PEP 562), so that importing the package stays cheap."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
