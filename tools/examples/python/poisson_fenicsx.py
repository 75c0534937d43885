#!/usr/bin/env python3
"""Heat in a bracket, by FEniCSx: as poisson.py, beside it, with the mesh and the tags of its sheets
handed to dolfinx as arrays. Needs python3-dolfinx (0.5 or later)."""
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import locvol
from dolfinx import fem
from poisson import bracket


def domain_of(mesh):
    """The mesh as dolfinx has it, and tags of its boundary's facets: ids of sheets."""
    element = ufl.VectorElement("Lagrange", ufl.tetrahedron, 1)
    domain = dolfinx.mesh.create_mesh(MPI.COMM_WORLD, mesh.cells, mesh.points, ufl.Mesh(element))
    # dolfinx orders points anew: facets are told by the numbers that points came with.
    entities, values = dolfinx.cpp.io.distribute_entity_data(
        domain._mesh, 2, mesh.boundary, mesh.sheets.astype(np.int32))  # fmt: skip
    domain.topology.create_connectivity(2, 0)
    domain.topology.create_connectivity(2, 3)
    facets = dolfinx.cpp.graph.AdjacencyList_int32(entities)
    return domain, dolfinx.mesh.meshtags_from_entities(domain, 2, facets, values)


def main():
    surface, groups, names = bracket()
    mesh = locvol.mesh(surface, "10%", groups=groups, names=names)
    domain, tags = domain_of(mesh)
    space = fem.FunctionSpace(domain, ("Lagrange", 1))
    ids = {sheet.name: sheet.id for sheet in mesh.sheet_list}
    conditions = []
    for name, temperature in {"back": 20.0, "tip": 100.0}.items():
        at = fem.locate_dofs_topological(space, 2, tags.find(ids[name]))
        conditions.append(fem.dirichletbc(PETSc.ScalarType(temperature), at, space))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    source = fem.Constant(domain, PETSc.ScalarType(0))
    problem = fem.petsc.LinearProblem(
        ufl.dot(ufl.grad(u), ufl.grad(v)) * ufl.dx, source * v * ufl.dx, bcs=conditions,
        petsc_options={"ksp_type": "cg", "ksp_rtol": 1e-10, "pc_type": "jacobi"})  # fmt: skip
    solution = problem.solve()
    normal, ds = ufl.FacetNormal(domain), ufl.Measure("ds", domain, subdomain_data=tags)
    values = solution.x.array
    print(f"{len(mesh.cells)} cells, temperatures from {values.min():.6f} to {values.max():.6f}")
    for name in ("back", "tip"):
        flow = fem.form(ufl.dot(ufl.grad(solution), normal) * ds(ids[name]))
        print(f"heat in at {name}: {fem.assemble_scalar(flow):.4f}, by the gradient on it")


if __name__ == "__main__":
    main()
