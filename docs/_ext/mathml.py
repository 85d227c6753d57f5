"""Write formulas as MathML, which every current browser draws: the pages need no script and no network."""

import re

from docutils.nodes import SkipNode
from latex2mathml.converter import convert


def visit_math(self, node):
    """Write a formula within the text."""
    self.body.append(convert(node.astext()))
    raise SkipNode


def visit_displaymath(self, node):
    """Write a formula of its own, with its number if it has one."""
    self.body.append(self.starttag(node, "div", CLASS="formula"))
    self.body.append(convert(aligned(node.astext()), display="block"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({node["number"]})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise SkipNode


def aligned(latex: str) -> str:
    """Align formulas that are separated by blank lines, or hold ``&`` or line breaks without an environment."""
    latex = re.sub(r"\\\\\[[^\]]*\]", r"\\\\", latex)  # room between lines, as in ``\\[2pt]``, would be printed
    rows = r" \\ ".join(part.strip() for part in latex.split("\n\n") if part.strip())
    is_plain = r"\begin" in rows or not (r"\\" in rows or "&" in rows)
    return rows if is_plain else rf"\begin{{aligned}}{rows}\end{{aligned}}"


def setup(app):
    """Register the renderer under the name ``mathml``."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_displaymath, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
