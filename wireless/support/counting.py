"""Numbers of things in words."""


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number with its noun: "1 task", "2 tasks".

    Args:
        number: How many.
        noun: One of them.
        plural: Several of them; the noun with an s if not given.
    """
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
