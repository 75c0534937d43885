#!/usr/bin/env python3
"""Turns CalculiX's result (NAME.frd) into a VTU file for ParaView, with displacement and von Mises
stress, and prints their extremes."""
import argparse
import array
import base64
import math
import sys

VTK_TYPES = {4: 10, 10: 24}  # by the number of nodes: tetrahedra, linear and quadratic


class Result:
    """Nodes, elements, and the values at nodes of each field, by the nodes' labels."""

    def __init__(self, file):
        self.nodes, self.elements, self.fields = {}, [], {}
        values = None
        for line in file:
            key, block = line[:3], line.strip()[:2]
            if key == " -1" and values == "elements":
                self.elements.append([])
            elif key == " -2" and values == "elements":
                self.elements[-1].extend(map(int, line[3:].split()))
            elif key == " -1" and isinstance(values, dict):
                numbers = [float(line[i : i + 12]) for i in range(13, len(line.rstrip()), 12)]
                values[int(line[3:13])] = numbers
            elif key == " -3":
                values = None
            elif key == " -4":
                values = self.fields.setdefault(line.split()[1], {})
            elif block == "2C":
                values = self.nodes
            elif block == "3C":
                values = "elements"
        for name in ("DISP", "STRESS"):
            if name not in self.fields:
                sys.exit(f"result.py: {file.name} has no {name}: did ccx end without an error?")


def von_mises(stress):
    xx, yy, zz, xy, yz, zx = stress
    squares = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return math.sqrt(squares / 2 + 3 * (xy * xy + yz * yz + zx * zx))


def data_array(name, kind, values, num_components=1):
    data = values.tobytes()
    text = base64.b64encode(len(data).to_bytes(8, "little") + data).decode()
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{num_components}" '
        f'format="binary">{text}</DataArray>\n'
    )


def write_vtu(out, result, stresses):
    places = {label: place for place, label in enumerate(result.nodes)}
    points = array.array("d", (c for p in result.nodes.values() for c in p))
    displacements = array.array("d", (c for n in result.nodes for c in result.fields["DISP"][n][:3]))
    cells = array.array("q", (places[n] for element in result.elements for n in element))
    ends, types, end = array.array("q"), array.array("B"), 0
    for element in result.elements:
        end += len(element)
        ends.append(end)
        types.append(VTK_TYPES[len(element)])
    out.write(
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(places)}" NumberOfCells="{len(types)}">\n<Points>\n'
        + data_array("Points", "Float64", points, 3)
        + "</Points>\n<Cells>\n"
        + data_array("connectivity", "Int64", cells)
        + data_array("offsets", "Int64", ends)
        + data_array("types", "UInt8", types)
        + "</Cells>\n<PointData>\n"
        + data_array("displacement", "Float64", displacements, 3)
        + data_array("von_mises", "Float64", array.array("d", stresses))
        + "</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frd", type=argparse.FileType(), help="NAME.frd")
    parser.add_argument("-o", "--output", required=True, help="the file to write, .vtu")
    arguments = parser.parse_args()
    result = Result(arguments.frd)
    stresses = [von_mises(result.fields["STRESS"][node]) for node in result.nodes]
    with open(arguments.output, "w", encoding="ascii") as out:
        write_vtu(out, result, stresses)
    largest = max(math.hypot(*u[:3]) for u in result.fields["DISP"].values())
    print(f"largest displacement {largest:.6g}, largest von Mises stress {max(stresses):.6g}")


if __name__ == "__main__":
    main()
