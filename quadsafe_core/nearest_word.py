"""What was meant by a word that is not known.

Without numpy: a command line asks before anything is loaded.
"""

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(word: object, options: Iterable[str]) -> str:
    """The end of a sentence that suggests the option nearest to ``word``; "" if none is near."""
    if not isinstance(word, str):
        return ""
    folded = {option.casefold(): option for option in options}
    nearest = get_close_matches(word.casefold(), folded, n=1)
    return f"; did you mean {folded[nearest[0]]!r}?" if nearest else ""
