"""Links to public names by the places where they are written: docstrings and pages name classes by their modules."""

import importlib

MODULES = ("bspline_mdao.plotting", "bspline_mdao.testing", "bspline_mdao")


def public_names():
    """Public name of every class and function by its module and name; the shortest one counts."""
    found = {}
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        for name in (name for name in dir(module) if not name.startswith("_")):
            thing = getattr(module, name)
            if callable(thing):
                found[f"{thing.__module__}.{thing.__qualname__}"] = f"{module_name}.{name}"
    return found


def link(app, env, node, text):
    """Resolve a reference to a class, function or member of a class by its module."""
    if node.get("refdomain") != "py":
        return None
    target, member = node["reftarget"], ""
    names = env.app.public_names
    if target not in names and target.rpartition(".")[0] in names:
        target, _, member = target.rpartition(".")
    if target not in names:
        return None
    public = f"{names[target]}.{member}" if member else names[target]
    return env.get_domain("py").resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, text)


def setup(app):
    """Connect the links."""
    app.public_names = public_names()
    app.connect("missing-reference", link)
    return {"parallel_read_safe": True}
