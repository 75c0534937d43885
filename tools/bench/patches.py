#!/usr/bin/env python3
"""Cuts a surface of bodies into patches for cgal_features, one for each pair of bodies that touch.

    patches.py SURFACE.ply DIRECTORY

SURFACE is as `locvol generate polycrystal` writes it: faces have their body, and what lies between
two bodies is there twice, with each of them once. Writes OFF files into DIRECTORY, and prints
PATCH:FRONT:BACK for each. Coordinates keep all of their digits, so that patches meet.
"""
import os
import re
import struct
import sys

HEADER = re.compile(rb"ply\nformat binary_little_endian 1\.0\nelement vertex (\d+)\n"
                    rb"property double x\nproperty double y\nproperty double z\n"
                    rb"element face (\d+)\nproperty list uchar uint vertex_indices\n"
                    rb"property uint region\n(?:comment .*\n)*end_header\n")
VERTEX = struct.Struct("<3d")
FACE = struct.Struct("<B4I")  # their number, three vertices, the body


def read_ply(path):
    """Vertices, and triangles with their body. Raises ValueError."""
    with open(path, "rb") as file:
        data = file.read()
    header = HEADER.match(data)
    if not header:
        raise ValueError(path + " is no surface of bodies as locvol generate writes it")
    num_vertices, num_faces = map(int, header.groups())
    faces_at = header.end() + num_vertices * VERTEX.size
    if len(data) != faces_at + num_faces * FACE.size:
        raise ValueError(path + " is cut short")
    vertices = list(VERTEX.iter_unpack(data[header.end():faces_at]))
    return vertices, [face[1:] for face in FACE.iter_unpack(data[faces_at:])]


def patches(faces):
    """Triangles by (front, back): the bodies before and behind them. 0 is the outside."""
    behind = {}  # the body behind a triangle, by its vertices from the smallest one on
    for *triangle, body in faces:
        first = triangle.index(min(triangle))
        behind[tuple(triangle[first:] + triangle[:first])] = body
    found = {}
    for (a, b, c), back in behind.items():
        front = behind.get((a, c, b), 0)
        if front < back:  # else it is taken from its other side
            found.setdefault((front, back), []).append((a, b, c))
    return found


def write_off(path, vertices, triangles):
    used = sorted({v for triangle in triangles for v in triangle})
    numbers = {v: i for i, v in enumerate(used)}
    with open(path, "w") as file:
        file.write("OFF\n%d %d 0\n" % (len(used), len(triangles)))
        file.writelines("%r %r %r\n" % vertices[v] for v in used)
        file.writelines("3 %d %d %d\n" % tuple(numbers[v] for v in triangle)
                        for triangle in triangles)


def main(surface, directory):
    vertices, faces = read_ply(surface)
    os.makedirs(directory, exist_ok=True)
    for (front, back), triangles in patches(faces).items():
        path = os.path.join(directory, "%d_%d.off" % (front, back))
        write_off(path, vertices, triangles)
        print("%s:%d:%d" % (path, front, back))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except (OSError, ValueError) as error:
        sys.exit("patches.py: %s" % error)
