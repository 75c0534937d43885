#!/usr/bin/env python3
"""Writes the bracket of bracket.py as STEP (AP214), as a CAD program would: plane faces and an exact
cylinder, each with its name."""
import argparse

from bracket import LENGTH, RADIUS, THICKNESS, WIDTH

FAR = THICKNESS + RADIUS
# The outline in the plane y = 0, counterclockwise seen from -y: where each face begins.
OUTLINE = [
    (0.0, 0.0, "below"), (LENGTH, 0.0, "tip"), (LENGTH, THICKNESS, "shelf"),
    (FAR, THICKNESS, "fillet"), (THICKNESS, FAR, "front"), (THICKNESS, LENGTH, "top"),
    (0.0, LENGTH, "back"),
]  # fmt: skip
HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('bracket'),'2;1');
FILE_NAME('bracket.step','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""


class Step:
    """Entities, in the order in which they are added."""

    def __init__(self):
        self.lines = []

    def add(self, text):
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def triple(self, kind, x, y, z):
        return self.add(f"{kind}('',({float(x)},{float(y)},{float(z)}))")

    def axes(self, place, axis, reference):
        a = self.triple("CARTESIAN_POINT", *place)
        b, c = self.triple("DIRECTION", *axis), self.triple("DIRECTION", *reference)
        return self.add(f"AXIS2_PLACEMENT_3D('',{a},{b},{c})")

    def edge(self, start, end, curve):
        return self.add(f"EDGE_CURVE('',{start},{end},{curve},.T.)")

    def face(self, name, edges, surface, same_sense=".T."):
        turned = [self.add(f"ORIENTED_EDGE('',*,*,{edge},{sense})") for edge, sense in edges]
        loop = self.add(f"EDGE_LOOP('',({','.join(turned)}))")
        bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        return self.add(f"ADVANCED_FACE('{name}',({bound}),{surface},{same_sense})")


def line(step, start, end):
    """Along a line of the length 1; from point to point."""
    along = [b - a for a, b in zip(start, end)]
    point = step.triple("CARTESIAN_POINT", *start)
    length = sum(d * d for d in along) ** 0.5
    direction = step.triple("DIRECTION", *(d / length for d in along))
    vector = step.add(f"VECTOR('',{direction},1.)")
    return step.add(f"LINE('',{point},{vector})")


def solid(step):
    places = {}  # of vertices, by number in the outline and side
    for i, (x, z, _) in enumerate(OUTLINE):
        for side, y in enumerate((0.0, WIDTH)):
            point = step.triple("CARTESIAN_POINT", x, y, z)
            places[i, side] = (x, y, z), step.add(f"VERTEX_POINT('',{point})")

    def edge(a, b):
        (start, v), (end, w) = places[a], places[b]
        if OUTLINE[a[0]][2] == "fillet" and a[1] == b[1]:
            axes = step.axes((FAR, start[1], FAR), (0, 1, 0), (0, 0, -1))
            return step.edge(v, w, step.add(f"CIRCLE('',{axes},{RADIUS})"))
        return step.edge(v, w, line(step, start, end))

    count = len(OUTLINE)
    across = [edge((i, 0), (i, 1)) for i in range(count)]
    along = [[edge((i, side), ((i + 1) % count, side)) for i in range(count)] for side in (0, 1)]
    faces = []
    for i, (x, z, name) in enumerate(OUTLINE):
        u, w, _ = OUTLINE[(i + 1) % count]
        following = (i + 1) % count
        ring = [(along[0][i], ".F."), (across[i], ".T."), (along[1][i], ".T."), (across[following], ".F.")]
        if name == "fillet":  # the material is around the cylinder
            axes = step.axes((FAR, 0, FAR), (0, 1, 0), (0, 0, -1))
            surface, sense = step.add(f"CYLINDRICAL_SURFACE('',{axes},{RADIUS})"), ".F."
        else:
            length = ((u - x) ** 2 + (w - z) ** 2) ** 0.5
            axes = step.axes((x, 0, z), ((w - z) / length, 0, (x - u) / length), (0, 1, 0))
            surface, sense = step.add(f"PLANE('',{axes})"), ".T."
        faces.append(step.face(name, ring, surface, sense))
    for side, name, y in ((0, "left", -1), (1, "right", 1)):
        axes = step.axes((0, side * WIDTH, 0), (0, y, 0), (1, 0, 0))
        ring = [(edge, ".T.") for edge in along[side]]
        if side:
            ring = [(edge, ".F.") for edge in reversed(along[side])]
        faces.append(step.face(name, ring, step.add(f"PLANE('',{axes})")))
    shell = step.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    return step.add(f"MANIFOLD_SOLID_BREP('bracket',{shell})")


def product(step, body):
    context = step.add("APPLICATION_CONTEXT('automotive design')")
    step.add(f"APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,{context})")
    part = step.add(f"PRODUCT_CONTEXT('',{context},'mechanical')")
    part = step.add(f"PRODUCT('bracket','bracket','',({part}))")
    part = step.add(f"PRODUCT_DEFINITION_FORMATION('','',{part})")
    design = step.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{context},'design')")
    part = step.add(f"PRODUCT_DEFINITION('design','',{part},{design})")
    shape = step.add(f"PRODUCT_DEFINITION_SHAPE('','',{part})")
    length = step.add("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )")
    angle = step.add("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid_angle = step.add("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    near = step.add(
        f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-06),{length},'distance_accuracy_value','')")
    space = step.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(3)"
        f" GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near}))"
        f" GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))"
        " REPRESENTATION_CONTEXT('','') )")  # fmt: skip
    axes = step.axes((0, 0, 0), (0, 0, 1), (1, 0, 0))
    form = step.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({axes},{body}),{space})")
    step.add(f"SHAPE_DEFINITION_REPRESENTATION({shape},{form})")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", required=True, help="the file to write, .step")
    step = Step()
    product(step, solid(step))
    with open(parser.parse_args().output, "w", encoding="ascii") as out:
        out.write(HEAD + "\n".join(step.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n")


if __name__ == "__main__":
    main()
