"""The directive ``functionals``: a table of the outputs of a flow, written from the package's."""

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList

from bspline_mdao.flow.functionals import of_flow
from bspline_mdao.flow.om.outputs import EXTENTS


def table(flow: str) -> list[str]:
    """Lines of the table."""
    lines = [".. list-table::", "   :header-rows: 1", ""]
    rows = [("output", "shape", "units", "meaning")]
    rows += [(f"``{n}``", EXTENTS[f.extent], f.units or "", f.meaning) for n, f in of_flow(flow).items()]
    for row in rows:
        lines += [f"   {'* -' if n == 0 else '  -'} {cell}" for n, cell in enumerate(row)]
    return lines


class Functionals(Directive):
    """``.. functionals:: euler`` or ``lattice``."""

    required_arguments = 1

    def run(self):
        """Parse the table."""
        place = nodes.Element()
        self.state.nested_parse(StringList(table(self.arguments[0]), "flow/functionals.py"), self.content_offset, place)
        return place.children


def setup(app):
    """Register the directive."""
    app.add_directive("functionals", Functionals)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
