"""What each column of the results means; Parquet files carry it, and the reference prints it."""

from typing import Final

# "*" stands for left and right, for the axes of a covariance, for what is counted, for a stage
MEANINGS: Final[dict[str, str]] = {
    "session": "the session's id",
    "frame": "the pair's place in its session",
    "time_ns": "the left exposure's time, since 1970",
    "apple": "the located fruit's number in its frame",
    "*_x_px": "the circle's centre in the recorded picture, from its left; pixel centres are whole",
    "*_y_px": "the circle's centre in the recorded picture, from its top",
    "*_radius_px": "the circle's radius in the recorded picture",
    "disparity_px": "left minus right column in the rectified pictures",
    "x_m": "the centre in the left camera's optical frame, to the right",
    "y_m": "the same, down",
    "z_m": "the same, forward",
    "radius_m": "of the fruit, as a sphere",
    "surface_range_m": "from the left camera to the fruit's front, on the line of sight",
    "confidence": "the chance that the fruit is one and matched rightly, as the method judges it",
    "range_std_m": "standard deviation of the centre's distance; 1.96 of it is a 95 % interval",
    "surface_std_m": "standard deviation of surface_range_m",
    "radius_std_m": "standard deviation of radius_m",
    "cov_*_m2": "covariance of the centre",
    "*_confidence": "the chance that this view's circle is a fruit",
    "*_inliers": "contour points on the circle",
    "*_area_px": "pixels of the circle's region",
    "*_truth": "the true apple that this view's circle finds; null: none",
    "*_false": "this view's circle is on no apple; null where nobody can know",
    "match_cost": "what the assignment paid for the pair",
    "*_fruit": "circles in this view",
    "matches": "circles matched; an impossible match has no place",
    "matched": "matches with a place",
    "reference_px": "the reference line of Eq. 3; null for methods without one",
    "readings": "rangefinder readings of this pair",
    "skew_ns": "right minus left exposure",
    "conditions": "lighting, cultivar, ... at that time",
    "*_tp": "true positives: pixels recognised, pixels left after cleaning, or fruit",
    "*_fp": "false positives; null where the truth is partial",
    "*_fn": "false negatives",
    "*_ns": "time of this stage, both views",
    "apple_id": "the true apple's id in its session",
    "distance_m": "its true distance along the line of sight, to its truth point",
    "*_visible": "the fraction of its outline that this view shows",
    "found_*": "a circle of this view finds it (IoU at least 0.5)",
    "match": "right, wrong or missed; null: not half visible in both views",
    "error_m": "estimated minus true distance; null: not matched rightly",
    "std_m": "the standard deviation that the method gave",
    "truth_point": "what distance_m leads to: centre or surface",
}


def circle_columns(side: str) -> tuple[str, str, str]:
    """The columns of a view's circle: x, y and radius in recorded pixels."""
    return f"{side}_x_px", f"{side}_y_px", f"{side}_radius_px"


def meaning(column: str) -> str | None:
    """What a column means, by its name or by the pattern that it follows."""
    if column in MEANINGS:
        return MEANINGS[column]
    patterns = [pattern.split("*") for pattern in MEANINGS if "*" in pattern]
    fitting = [(len(a) + len(b), f"{a}*{b}") for a, b in patterns
               if column.startswith(a) and column.endswith(b)]  # fmt: skip
    return MEANINGS[max(fitting)[1]] if fitting else None
