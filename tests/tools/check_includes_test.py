"""What tools/check_includes.py finds in small trees of sources.

Usage: check_includes_test.py CHECK_INCLUDES
"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

CHECK_INCLUDES = sys.argv.pop(1)


class CheckIncludesTest(unittest.TestCase):
    def check(self, files):
        """The exit code and the lines for a tree of files, each given as what it includes."""
        with tempfile.TemporaryDirectory() as root:
            for name, includes in files.items():
                path = pathlib.Path(root, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("".join(f'#include "{other}"\n' for other in includes.split()))
            result = subprocess.run([sys.executable, "-B", CHECK_INCLUDES, root],
                                    capture_output=True, text=True)
        self.assertEqual(result.stderr, "")
        return result.returncode, result.stdout.splitlines()

    def test_accepts_arrows_that_run_down(self):
        self.assertEqual(
            self.check({"octree/a.h": "", "octree/a.cpp": "octree/a.h lmdb.h gone/b.h",
                        "engine/run/b.cpp": "octree/a.h engine/plan/c.h", "engine/plan/c.h": "",
                        "tests/b_test.cpp": "engine/plan/c.h"}),
            (0, ["no cycle of folders or units, no arrow up"]))

    def test_finds_a_cycle_of_folders(self):
        code, lines = self.check({"engine/a.h": "engine/run/b.h", "engine/run/b.h": "",
                                  "engine/run/c.cpp": "engine/d.h", "engine/d.h": ""})
        self.assertEqual(code, 1)
        self.assertEqual(lines, ["cycle of folders: engine -> engine/run -> engine",
                                 "  engine/a.h includes engine/run/b.h",
                                 "  engine/run/c.cpp includes engine/d.h"])

    def test_takes_header_and_source_for_one_unit(self):
        code, lines = self.check({"refine/x.h": "", "refine/x.cpp": "refine/y.h",
                                  "refine/y.h": "refine/z.h", "refine/z.h": "",
                                  "refine/z.cpp": "refine/x.h"})
        self.assertEqual(code, 1)
        self.assertEqual(lines[0],
                         "cycle of units: refine/x -> refine/y -> refine/z -> refine/x")
        self.assertEqual(len(lines), 4)

    def test_finds_each_cycle(self):
        _, lines = self.check({"octree/a.h": "octree/b.h", "octree/b.h": "octree/a.h octree/c.h",
                               "octree/c.h": "octree/b.h"})
        self.assertEqual([line for line in lines if line.startswith("cycle")],
                         ["cycle of units: octree/a -> octree/b -> octree/a",
                          "cycle of units: octree/c -> octree/b -> octree/c"])

    def test_finds_arrows_up_and_across(self):
        self.assertEqual(
            self.check({"refine/a.h": "storage/b.h", "storage/b.h": "", "octree/c.h": "tools/d.h",
                        "tools/d.h": ""}),
            (1, ["arrow up: octree/c.h includes tools/d.h",
                 "arrow up: refine/a.h includes storage/b.h"]))


if __name__ == "__main__":
    unittest.main()
