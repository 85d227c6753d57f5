"""The report page: one HTML file with a 3D view of the grid, its quality, and the history of an optimisation.

It needs plotly and jinja2: ``pip install bspline_mdao[report]``. Both are imported when a report is written.
"""
