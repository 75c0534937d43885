#!/usr/bin/env python3
"""Writes a wall of three layers as OBJ, each a group by its name: plaster, foam and brick. In meters.

Between them, each has the face with triangles of its own."""
import argparse

WIDTH = 0.2
LAYERS = {"plaster": (0.0, 0.02), "foam": (0.02, 0.1), "brick": (0.1, 0.2)}  # from x to x
# Corners of a box, of which bit 0, 1 and 2 of the number say x, y and z; outward.
TRIANGLES = [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
             (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)]  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", required=True, help="the file to write, .obj")
    with open(parser.parse_args().output, "w", encoding="ascii") as out:
        for number, (name, ends) in enumerate(LAYERS.items()):
            out.write(f"g {name}\n")
            for corner in range(8):
                x, y, z = (corner >> axis & 1 for axis in range(3))
                out.write(f"v {ends[x]} {WIDTH * y} {WIDTH * z}\n")
            for triangle in TRIANGLES:
                out.write("f {} {} {}\n".format(*(8 * number + corner + 1 for corner in triangle)))


if __name__ == "__main__":
    main()
