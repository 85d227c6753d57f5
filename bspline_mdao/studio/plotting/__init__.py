"""Pictures of grids, control meshes, wings and optimisations; `bspline_mdao.plotting` has their public names."""
