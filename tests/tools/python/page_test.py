"""The examples on the page about Python: run, one after another, in a directory with a part.

Usage: page_test.py TOOLS PACKAGE   TOOLS: the directory of the page
"""
import doctest
import math
import os
import pathlib
import sys
import tempfile

TOOLS, PACKAGE = sys.argv[1:3]
sys.path.insert(0, str(pathlib.Path(PACKAGE).resolve()))


def torus(num_around, num_across):
    """As text STL."""
    def point(i, j):
        a = 2 * math.pi * (i % num_around) / num_around
        b = 2 * math.pi * (j % num_across) / num_across
        r = 1 + 0.4 * math.cos(b)
        return r * math.cos(a), r * math.sin(a), 0.4 * math.sin(b)

    yield "solid torus\n"
    for i in range(num_around):
        for j in range(num_across):
            a, b, c, d = point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)
            for corners in ((a, b, c), (a, c, d)):
                yield "facet normal 0 0 0\nouter loop\n"
                for corner in corners:
                    yield "vertex {:.9g} {:.9g} {:.9g}\n".format(*corner)
                yield "endloop\nendfacet\n"
    yield "endsolid torus\n"


with tempfile.TemporaryDirectory() as scratch:
    page = pathlib.Path(TOOLS, "python.md").resolve()
    os.chdir(scratch)
    pathlib.Path("part.stl").write_text("".join(torus(60, 24)), encoding="ascii")
    failed, tried = doctest.testfile(str(page), module_relative=False, encoding="utf-8")
    os.chdir("/")
print(f"{tried} examples, {failed} failed")
sys.exit(1 if failed or tried < 30 else 0)
