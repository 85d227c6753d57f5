"""The gallery shows every script that draws once, under the heading of what it is about."""

import sys
from itertools import chain
from pathlib import Path

import pytest

pytest.importorskip("sphinx_gallery", reason="sphinx-gallery is not installed")
sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "_ext"))

import drawings

THUMBNAIL = """.. raw:: html

    <div class="sphx-glr-thumbcontainer" tooltip="{name}">

.. only:: html

  .. image:: /gallery/images/thumb/sphx_glr_{name}_thumb.png

  :doc:`/gallery/{name}`

.. raw:: html

      <div class="sphx-glr-thumbnail-title">{name}</div>
    </div>


"""

HTML = ".. raw:: html\n\n    {}\n\n"


def test_every_script_that_draws_has_one_group():
    names = list(chain.from_iterable(drawings.GROUPS.values()))
    assert sorted(names) == sorted(path.stem for path in drawings.SCRIPTS.glob("*.py") if drawings.draws(path))


def test_thumbnails_stand_under_the_headings_of_their_groups():
    names = sorted(chain.from_iterable(drawings.GROUPS.values()))
    index = "Gallery\n=======\n\n" + HTML.format('<div class="sphx-glr-thumbnails">')
    index += ".. thumbnail-parent-div-open\n\n" + "".join(THUMBNAIL.format(name=name) for name in names)
    index += ".. thumbnail-parent-div-close\n\n" + HTML.format("</div>") + ".. toctree::\n   :hidden:\n"
    page = drawings.grouped(index)
    assert page.startswith("Gallery\n=======\n")
    assert page.endswith(".. toctree::\n   :hidden:\n")
    assert page.count("<div") == page.count("</div>")
    at = [page.index(f"\n{title}\n{'-' * len(title)}\n") for title in drawings.GROUPS]
    assert at == sorted(at)
    for start, end, members in zip(at, [*at[1:], len(page)], drawings.GROUPS.values()):
        found = [page.index(f":doc:`/gallery/{name}`") for name in members]
        assert found == sorted(found)
        assert start < found[0]
        assert found[-1] < end
