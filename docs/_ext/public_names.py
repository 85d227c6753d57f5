"""Links to public names: docstrings and pages name classes by the modules where they are written, or alone."""

from types import ModuleType

import bspline_mdao


def public_names():
    """Public name of every class and function by its module and name, and by its name alone."""
    found = {}
    spaces = [space for name in bspline_mdao.__all__ if isinstance(space := getattr(bspline_mdao, name), ModuleType)]
    for module in (*spaces, bspline_mdao):
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing):
                found[f"{thing.__module__}.{thing.__qualname__}"] = found[name] = f"{module.__name__}.{name}"
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
