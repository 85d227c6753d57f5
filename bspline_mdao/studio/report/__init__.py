"""The report page: one HTML file with the grid in space, its quality, and the history of an optimisation.

It needs plotly and jinja2: ``pip install bspline_mdao[report]``. Both are imported when a report is written.
"""
