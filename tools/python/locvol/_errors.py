"""Errors, a class for each kind."""
import re

from . import _options


class Error(Exception):
    """All that goes wrong in locvol.

    Attributes:
        place (str | None): The file, store, option or shape that it is about, if the message names
            one first.
        cure (str | None): What to do about it, if the message says so last.
    """

    def __init__(self, message):
        super().__init__(message)
        self.place, self.cure = _place(message), _cure(message)


class InputError(Error, ValueError):
    """The surface, or an option: not closed, intersects itself, size out of range ..."""


class MismatchError(Error):
    """The store holds a run of another surface or under other options."""


class MemoryLimitError(Error, MemoryError):
    """`memory` is too small, or the system gives no more. What was committed is kept."""


class StoreError(Error):
    """The store: not there, in use by another process, damaged, unfinished, of another version."""


class SystemFailure(Error, OSError):
    """The disk is full, a file cannot be written ... What was committed is kept."""


class InternalError(Error):
    """A bug of locvol."""


class Interrupted(Error):
    """A run that was stopped, by Ctrl-C or by `progress`, after a commit.

    Attributes:
        mesh (Mesh | None): The run as it stands: `mesh.resume()` goes on with it, to the same
            bytes. None if it was stopped before the surface was read: then nothing is kept.
    """

    mesh = None


# By ErrorCode.
_CLASSES = (
    InputError, MismatchError, MemoryLimitError, StoreError, SystemFailure, Interrupted,
    InternalError)  # fmt: skip

# What begins a cure.
_DOING = (
    "add|ask|begin|bring|check|choose|close|free|get|give|go on|keep|leave|make|mend|move|name|"
    "raise|remove|repair|restore|resume|scale|start|try|use|wrap|write")


def error_of(code, message):
    """The error of that ErrorCode, whose message is in the words of the command."""
    return _CLASSES[code](_options.in_python(message))


def _place(message):
    """What comes before the first colon, if it is short: else it is part of what is wrong."""
    place, colon, rest = message.partition(": ")
    place = re.sub(r"^cannot \w+ ", "", place)
    return place if colon and rest and len(place.split()) <= 4 else None


def _cure(message):
    starts = [match.end() for match in re.finditer(r"[;:.] ", message)]
    for start in reversed(starts):
        if re.match(rf"(?:{_DOING})\b", message[start:], re.IGNORECASE):
            # It may go on in further clauses, of which each is a cure, too.
            before = [s for s in starts if s < start]
            while before and re.match(rf"(?:{_DOING})\b", message[before[-1]:], re.IGNORECASE):
                start = before.pop()
            return message[start:]
    return None
