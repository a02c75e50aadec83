"""Words for people: a number with its noun."""


def counted(number: int, noun: str) -> str:
    """`1 pair`, `7 pairs`: every noun here makes its plural with an s."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
