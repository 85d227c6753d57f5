"""Lead the links [docs] of listings of modules to the place where a public name is documented."""

import re
from collections.abc import Collection

LINK = re.compile(r'(<a class="viewcode-back" href=")([^"#]*?([\w.]+)\.html)#([^"]+)"')
"""Its beginning, address, name of the page and anchor, for which viewcode takes one of the names of the object."""


def mended(body: str, anchors: Collection[str]) -> str:
    """Body of a listing whose links end at anchors that are there, or at the top of their page."""

    def lead(link: re.Match) -> str:
        start, address, page, anchor = link.groups()
        if anchor in anchors and anchor.startswith(page):
            return link[0]
        member = re.search(rf"\b{re.escape(page.rpartition('.')[2])}\b(.*)$", anchor)
        there = page + member[1] if member else page
        return f'{start}{address}#{there}"' if there in anchors else f'{start}{address}"'

    return LINK.sub(lead, body)


def mend(app, pagename, templatename, context, doctree) -> None:
    """Mend a listing before it is written."""
    if pagename.startswith("_modules/") and "body" in context:
        context["body"] = mended(context["body"], app.env.get_domain("py").objects)


def setup(app):
    """Connect it."""
    app.connect("html-page-context", mend)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
