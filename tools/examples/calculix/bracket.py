#!/usr/bin/env python3
"""Writes a bracket as text STL, with a name for each of its faces: two plates that meet in a fillet.

`back` is against a wall, `shelf` carries the load. In millimeters."""
import argparse
import math

LENGTH, THICKNESS, RADIUS, WIDTH, STEPS = 60.0, 8.0, 10.0, 40.0, 12


def profile():
    """Corners in the plane y = 0, counterclockwise seen from -y, each with the name of the face that
    begins there. All of them are seen from the first one."""
    t, far = THICKNESS, THICKNESS + RADIUS
    arc = [math.pi / 2 * i / STEPS for i in range(STEPS + 1)]
    corners = [(0, 0, "below"), (LENGTH, 0, "tip"), (LENGTH, t, "shelf")]
    corners += [(far - RADIUS * math.sin(a), far - RADIUS * math.cos(a), "fillet") for a in arc]
    corners[-1] = (t, far, "front")
    return corners + [(t, LENGTH, "top"), (0, LENGTH, "back")]


def faces():
    """Triangles by the names of their faces, outward."""
    corners, found = profile(), {}
    for (x, z, name), (u, w, _) in zip(corners, corners[1:] + corners[:1]):
        a, b, c, d = (x, 0, z), (u, 0, w), (u, WIDTH, w), (x, WIDTH, z)
        found.setdefault(name, []).extend([(a, c, b), (a, d, c)])
    for (x, z, _), (u, w, _) in zip(corners[1:], corners[2:]):
        left = (0, 0, 0), (x, 0, z), (u, 0, w)
        found.setdefault("left", []).append(left)
        found.setdefault("right", []).append([(p, WIDTH, q) for p, _, q in reversed(left)])
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", required=True, help="the file to write, .stl")
    with open(parser.parse_args().output, "w", encoding="ascii") as out:
        for name, triangles in faces().items():
            out.write(f"solid {name}\n")
            for triangle in triangles:
                out.write("facet normal 0 0 0\nouter loop\n")
                for corner in triangle:
                    out.write("vertex {} {} {}\n".format(*corner))
                out.write("endloop\nendfacet\n")
            out.write(f"endsolid {name}\n")


if __name__ == "__main__":
    main()
