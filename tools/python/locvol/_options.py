"""Options of a run: those of the command, whose one table they come from."""
import functools
import re
import textwrap
from dataclasses import dataclass


@dataclass(frozen=True)
class Ball:
    """A ball in which cells are smaller.

    Attributes:
        size: Of cells in it, as `size` of `mesh`.
        center: (x, y, z).
        radius: A length, 0 or more; 0: a point.
    """

    size: object
    center: tuple
    radius: float = 0.0


@dataclass(frozen=True)
class Box:
    """A box in which cells are smaller, along the axes.

    Attributes:
        size: Of cells in it, as `size` of `mesh`.
        a, b: Two opposite corners, (x, y, z) each.
    """

    size: object
    a: tuple
    b: tuple
    is_box = True


@dataclass(frozen=True)
class Segment:
    """A segment along which cells are smaller.

    Attributes:
        size: Of cells on it, as `size` of `mesh`.
        a, b: Its ends, (x, y, z) each.
    """

    size: object
    a: tuple
    b: tuple
    is_box = False


# What the command has no help for.
_HELP = {
    "size": "λ: a length, or a percentage of the smallest side of the bounding box (default: "
            "chosen for about half a million cells, and told to the log)",
    "shapes": "A list of Ball, Box and Segment, where cells are to be smaller; around them they "
              "grow by 0.2 of the way, unless growth is given",
    "sheet_sizes": "A dict from names of sheets, or of groups of the surface, to sizes there",
    "body_sizes": "A dict from names of bodies to sizes in them",
    "size_image": "A VTK image (.vti) of sizes: the name of its file",
    "sharp": "Polylines along edges of the surface that are sharp whatever their angle: the name "
             "of a file (CGAL's .polylines.txt)",
    "has_bodies": "True: each group of the surface that is closed by itself is a body; without "
                  "groups, each shell is",
    "voids": "A list of names: these bodies are none, but cavities of those that they lie in",
    "surface_only": "True: mesh the surface alone, into triangles, and no cells",
}  # fmt: skip
# Of these a command-line name stands for several.
_TYPED = {"sizes": "shapes", "sharp": "sharp", "bodies": "has_bodies", "void": "voids"}



@functools.cache
def rows():
    """A dict for each option, in order: name, typed (by who uses the command) and help."""
    from . import _locvol  # which imports the errors, and these the options

    return tuple(_locvol.option_rows())


def names():
    """Of all options, in order."""
    return tuple(row["name"] for row in rows())


def in_python(text):
    """Command-line options as this module calls them."""
    typed = {row["typed"]: row["name"] for row in rows()}
    typed.update({f"--{name}": key for name, key in _TYPED.items()})

    def name_of(match):
        plain = match[0][2:].replace("-", "_")
        return typed.get(match[0], plain)

    return re.sub(r"--[a-z][a-z-]*", name_of, text)


def help_of(row):
    """What the option is, in a sentence."""
    return in_python(row["help"] or _HELP[row["name"]])


def documentation():
    """All options, as docstrings list parameters."""
    return "\n".join(
        textwrap.fill(f"{row['name']}: {help_of(row)}.", 100, initial_indent=" " * 8,
                      subsequent_indent=" " * 12) for row in rows())  # fmt: skip
