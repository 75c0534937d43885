#!/usr/bin/env python3
"""From a surface to the stresses in a part, as a notebook would go: a bracket held at its back
carries 500 N on its shelf. Needs the scripts of the examples for CalculiX, and ccx.

Usage: stresses.py [DIRECTORY]   for the files; default: here"""
import pathlib
import subprocess
import sys

SCRIPTS = pathlib.Path(__file__).resolve().parent
CALCULIX = SCRIPTS.parent / "calculix"
sys.path[1:1] = [str(SCRIPTS), str(CALCULIX)]

import locvol  # noqa: E402
from bracket import RADIUS  # noqa: E402
from poisson import bracket  # noqa: E402
from result import Result, von_mises  # noqa: E402

here = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".")

# -- The surface: triangles, and a name for each face. What will it take?
surface, groups, names = bracket()
info = locvol.info(surface, groups=groups, names=names)
print(f"{info.num_triangles} triangles, volume {info.volume:.6g} mm³, faces: {', '.join(names)}")
sizes = {"fillet": 1.5}
estimate = locvol.estimate(info, 5.0, sheet_sizes=sizes)
print(f"about {estimate.num_cells:.2g} cells, {estimate.run_seconds:.2g} s")

# -- The mesh, with small cells in the fillet, where the stress is.
mesh = locvol.mesh(surface, 5.0, sheet_sizes=sizes, groups=groups, names=names)
quality = mesh.statistics()
print(f"{quality.num_cells} cells, angles {quality.min_dihedral_degrees:.1f}° to "
      f"{quality.max_dihedral_degrees:.1f}°")  # fmt: skip
fillet = next(sheet for sheet in mesh.sheet_list if sheet.name == "fillet")
assert fillet.form == "cylinder" and abs(fillet.radius - RADIUS) < 1e-3, fillet

# -- The analysis: quadratic elements, faces by their names.
mesh.write(here / "bracket.inp", order=2)
subprocess.run(
    [sys.executable, "-B", CALCULIX / "case.py", "bracket.inp", "-o", "stresses.inp", "--hold",
     "back", "--load", "shelf", "--force", "0,0,-500"], check=True, cwd=here)  # fmt: skip
subprocess.run(["ccx", "stresses"], check=True, cwd=here, stdout=subprocess.DEVNULL)

# -- The result.
with open(here / "stresses.frd", encoding="ascii") as file:
    result = Result(file)
stress = {label: von_mises(values[:6]) for label, values in result.fields["STRESS"].items()}
near = {label: s for label, s in stress.items() if result.nodes[label][0] > 3}  # off the held face
largest = max(near, key=near.get)
print(f"largest stress: {near[largest]:.1f} N/mm² at", *(f"{c:.1f}" for c in result.nodes[largest]))
deflection = min(values[2] for values in result.fields["DISP"].values())
print(f"deflection: {deflection:.4f} mm")
