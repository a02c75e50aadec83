import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.pairing import pair_by_time


def pairs(left: list[int], right: list[int], limit: int) -> list[list[int]]:
    found = pair_by_time(np.array(left, np.int64), np.array(right, np.int64), limit)
    return [[int(a), int(b)] for a, b in found]


def test_frames_of_one_time_pair() -> None:
    assert pairs([0, 10, 20], [0, 10, 20], 0) == [[0, 0], [1, 1], [2, 2]]


def test_a_skew_at_the_limit_pairs_and_one_beyond_it_does_not() -> None:
    assert pairs([100, 200], [105, 206], 5) == [[0, 0]]


def test_a_lost_frame_leaves_its_partner_alone_and_shifts_nobody() -> None:
    assert pairs([0, 10, 20, 30], [0, 20, 30], 4) == [[0, 0], [2, 1], [3, 2]]


def test_of_two_candidates_the_nearer_is_taken() -> None:
    assert pairs([10], [7, 12], 5) == [[0, 1]]
    assert pairs([7, 12], [10], 5) == [[1, 0]]


def test_of_two_equally_near_the_earlier_is_taken() -> None:
    assert pairs([10], [8, 12], 5) == [[0, 0]]


def test_two_frames_of_one_time_make_one_pair() -> None:
    assert pairs([10, 10], [10, 10], 5) == [[0, 0]]


@pytest.mark.parametrize(("left", "right"), [([], [1]), ([1], []), ([], [])])
def test_a_view_without_frames_makes_no_pair(left: list[int], right: list[int]) -> None:
    assert pairs(left, right, 10**18) == []


times = st.lists(st.integers(0, 300), max_size=25).map(sorted)


@given(left=times, right=times, limit=st.integers(0, 40))
def test_no_frame_is_in_two_pairs_and_no_pair_is_wider_than_the_limit(
    left: list[int], right: list[int], limit: int
) -> None:
    found = pairs(left, right, limit)
    firsts, seconds = [a for a, _ in found], [b for _, b in found]
    assert firsts == sorted(set(firsts))
    assert seconds == sorted(set(seconds))
    for a, b in found:
        skew = abs(left[a] - right[b])
        assert skew <= limit
        assert skew == min(abs(left[a] - other) for other in right)
        assert skew == min(abs(right[b] - other) for other in left)


@given(left=times, right=times, limit=st.integers(0, 40))
def test_pairing_does_not_depend_on_which_camera_is_called_left(
    left: list[int], right: list[int], limit: int
) -> None:
    # of two equally near the earlier wins, which is one rule for both views only without ties
    left, right = [3 * t for t in dict.fromkeys(left)], [3 * t + 1 for t in dict.fromkeys(right)]
    there = pairs(left, right, limit)
    assert there == [[a, b] for b, a in pairs(right, left, limit)]
