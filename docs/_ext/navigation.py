"""Keep the list of pages beside each page short: without those of single names, which tables of the reference have."""

DEPTH = 2
"""Levels that are shown: the lists of the landing page, and what is below."""


def shorten(app, pagename, templatename, context, doctree) -> None:
    """Limit the depth; the theme asks for all levels, and reads them again for each page, which is most of the work."""
    whole = context.get("toctree")
    if whole is not None:
        context["toctree"] = lambda **options: whole(**{**options, "maxdepth": DEPTH})


def setup(app):
    """Be there before the theme, whose own function has the priority 500."""
    app.connect("html-page-context", shorten, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
