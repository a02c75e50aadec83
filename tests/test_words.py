"""Words for people."""

from recorder.words import counted


def test_a_noun_is_plural_unless_there_is_one() -> None:
    assert [counted(n, "pair") for n in (0, 1, 2)] == ["0 pairs", "1 pair", "2 pairs"]
