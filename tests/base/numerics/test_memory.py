"""Memory that is left."""

from bspline_mdao.base.numerics import memory


def test_memory_of_a_group_counts_where_it_is_less(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "GROUP", tmp_path)
    free = memory.available_bytes()
    assert 10**7 < free < 10**15
    (tmp_path / "memory.max").write_text("3000000\n")
    (tmp_path / "memory.current").write_text("1000000\n")
    assert memory.available_bytes() == 2_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available_bytes() > 2_000_000
