#!/usr/bin/env python3
"""Writes a linear static analysis for CalculiX around a mesh from `locvol mesh -o PART.inp`.

Boundary nodes in one place are held, and a force is spread over the boundary facets in another,
as a traction of the same size everywhere. A place is a sheet of the mesh by its name, or a region:
one or several conditions, such as 'x<-0.8'.
"""
import argparse
import math
import re
import sys

# Nodes of each face by Abaqus' number: corners, and what C3D10 has in the middle of the edges.
FACES = {"S1": (0, 1, 2, 4, 5, 6), "S2": (0, 1, 3, 4, 8, 7), "S3": (1, 2, 3, 5, 9, 8),
         "S4": (0, 2, 3, 6, 9, 7)}  # fmt: skip


class Mesh:
    """Nodes and elements by their labels; facets of surfaces, by name, as node labels."""

    def __init__(self, file):
        self.nodes, self.elements, self.surfaces, self.type = {}, {}, {}, ""
        section, facets = "", []
        for line in file:
            if line.startswith("*"):
                section = line.split(",")[0].strip().upper()
                if section == "*ELEMENT":
                    self.type = re.search(r"TYPE=([^,\s]+)", line).group(1)
                if section == "*SURFACE":
                    name = re.search(r"NAME=([^,\s]+)", line).group(1)
                    facets = self.surfaces.setdefault(name, [])
                continue
            fields = line.split(",")
            if section == "*NODE":
                self.nodes[int(fields[0])] = tuple(map(float, fields[1:4]))
            elif section == "*ELEMENT":
                self.elements[int(fields[0])] = tuple(map(int, fields[1:]))
            elif section == "*SURFACE":
                element = self.elements[int(fields[0])]
                face = FACES[fields[1].strip()]
                facets.append(tuple(element[i] for i in face if i < len(element)))
        self.facets = self.surfaces.get("boundary", [])
        if not self.elements or not self.facets:
            sys.exit(f"case.py: {file.name} has no elements or no boundary: is it from locvol?")

    def area(self, facet):
        a, b, c = (self.nodes[n] for n in facet[:3])
        u, v = [[q - p for p, q in zip(a, end)] for end in (b, c)]
        normal = [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]
        return math.hypot(*normal) / 2


class Region:
    """Conditions on coordinates, all of which must hold."""

    def __init__(self, text):
        self.conditions = []
        for condition in text.split(","):
            match = re.fullmatch(r"\s*([xyz])\s*([<>])\s*(\S+)\s*", condition)
            if not match:
                raise argparse.ArgumentTypeError(f"'{condition}' is not like x<0.5")
            axis, sign, value = match.groups()
            self.conditions.append(("xyz".index(axis), 1 if sign == ">" else -1, float(value)))

    def __contains__(self, point):
        return all(sign * (point[axis] - value) > 0 for axis, sign, value in self.conditions)

    def facets_of(self, mesh):
        return [facet for facet in mesh.facets if all(mesh.nodes[n] in self for n in facet)]

    def nodes_of(self, mesh):
        return {n for facet in mesh.facets for n in facet if mesh.nodes[n] in self}


class Sheet:
    """A surface of the mesh, by its name."""

    def __init__(self, name):
        self.name = name

    def facets_of(self, mesh):
        if self.name not in mesh.surfaces:
            sys.exit(f"case.py: there is no sheet '{self.name}': {', '.join(mesh.surfaces)}")
        return mesh.surfaces[self.name]

    def nodes_of(self, mesh):
        return {n for facet in self.facets_of(mesh) for n in facet}


def place(text):
    return Region(text) if "<" in text or ">" in text else Sheet(text)


def vector(text):
    parts = [float(part) for part in text.split(",")]
    if len(parts) != 3:
        raise argparse.ArgumentTypeError("give three numbers, such as 1000,0,0")
    return parts


def spread(mesh, facets, force):
    """The share of each node in the force: an even load on a facet is carried by its three corners in
    equal parts; of six nodes, by those in the middle of edges."""
    areas = [mesh.area(facet) for facet in facets]
    total, loads = math.fsum(areas), {}
    for facet, area in zip(facets, areas):
        for node in facet[-3:]:
            loads[node] = loads.get(node, 0.0) + area / total / 3
    return {node: [share * f for f in force] for node, share in loads.items()}


def write_set(out, name, labels):
    out.write(f"*NSET, NSET={name}\n")
    for i in range(0, len(labels), 16):
        out.write(", ".join(map(str, labels[i : i + 16])) + "\n")


def write_case(out, mesh, held, loads, arguments):
    out.write("*HEADING\nlinear statics\n*NODE, NSET=all\n")
    for label, (x, y, z) in mesh.nodes.items():
        out.write(f"{label}, {x:.13g}, {y:.13g}, {z:.13g}\n")
    out.write(f"*ELEMENT, TYPE={mesh.type}, ELSET=volume\n")
    for label, nodes in mesh.elements.items():
        out.write(f"{label}, " + ", ".join(map(str, nodes)) + "\n")
    write_set(out, "held", held)
    out.write(
        f"*MATERIAL, NAME=material\n*ELASTIC\n{arguments.young}, {arguments.poisson}\n"
        "*SOLID SECTION, ELSET=volume, MATERIAL=material\n"
        f"*STEP\n*STATIC, SOLVER={arguments.solver}\n*BOUNDARY\nheld, 1, 3\n*CLOAD\n"
    )
    for node, force in loads.items():
        for axis, component in enumerate(force, 1):
            if component:
                out.write(f"{node}, {axis}, {component:.13g}\n")
    out.write(
        "*NODE PRINT, NSET=held, TOTALS=ONLY\nRF\n*NODE FILE\nU\n*EL FILE\nS\n*END STEP\n"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=argparse.FileType(), help="PART.inp")
    parser.add_argument("-o", "--output", required=True, help="the case, NAME.inp")
    parser.add_argument("--hold", type=place, required=True, help="sheet or region, such as 'x<-0.8'")
    parser.add_argument("--load", type=place, required=True, help="likewise, such as 'x>0.8,z>0'")
    parser.add_argument("--force", type=vector, required=True, help="in all: FX,FY,FZ")
    parser.add_argument("--young", type=float, default=210000, help="modulus (210000)")
    parser.add_argument("--poisson", type=float, default=0.3, help="ratio (0.3)")
    parser.add_argument("--solver", default="SPOOLES", help="SPOOLES, or 'ITERATIVE CHOLESKY'")
    arguments = parser.parse_args()

    mesh = Mesh(arguments.mesh)
    loaded = arguments.load.facets_of(mesh)
    held = sorted(arguments.hold.nodes_of(mesh))
    for what, found in (("--hold", held), ("--load", loaded)):
        if not found:
            sys.exit(f"case.py: nothing of the boundary lies in the region of {what}")
    loads = spread(mesh, loaded, arguments.force)
    with open(arguments.output, "w", encoding="ascii") as out:
        write_case(out, mesh, held, loads, arguments)
    print(
        f"{len(mesh.nodes)} nodes, {len(mesh.elements)} elements; {len(held)} nodes are held, "
        f"{len(loaded)} facets loaded"
    )


if __name__ == "__main__":
    main()
