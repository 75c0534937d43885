"""What tools/run_tests.py says of skipped tests, with ctest itself and tests of one line each.

Usage: run_tests_test.py RUN_TESTS
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

RUN_TESTS = sys.argv.pop(1)

# The two ways to skip, as tests/CMakeLists.txt has them.
SCRIPT = "SKIP_RETURN_CODE 77"
GOOGLE_TEST = r'SKIP_REGULAR_EXPRESSION "\\[  SKIPPED \\]"'
SUITE = r'FAIL_REGULAR_EXPRESSION "Running 0 tests"'

PASSES = ("passes", "exit 0", SCRIPT)
FAILS = ("fails", "echo skipped: not at all; exit 1", SCRIPT)
NO_CCX = ("no_ccx", "echo skipped: needs ccx. To run it: install ccx; exit 77", SCRIPT)
SILENT = ("silent", "exit 77", SCRIPT)


def no_models(name):
    # Longer than what ctest keeps of the output of a test that passed.
    return (name, "seq 2000; echo a_test.cpp:27: Skipped; "
            "echo needs models. To run it: MODELS=DIR; echo; echo '[  SKIPPED ] A.b'", GOOGLE_TEST)


def suite_of(name, exit_code=0):
    # Its second case is skipped, amid more output than ctest keeps by itself.
    suite = name.partition("/")[2]
    said = "; ".join(f"echo '{line}'" for line in (
        f"[ RUN      ] {suite}.First", f"[       OK ] {suite}.First (9 ms)",
        f"[ RUN      ] {suite}.Second", "a_test.cpp:27: Skipped", "needs models. To run it: MODELS=DIR",
        "", f"[  SKIPPED ] {suite}.Second (0 ms)",
        f"[ RUN      ] {suite}.Third", f"[       OK ] {suite}.Third (9 ms)"))
    return (name, f"seq 2000; {said}; seq 2000; exit {exit_code}", SUITE)


class RunTestsTest(unittest.TestCase):
    def run_tests(self, *tests, arguments=(), may_skip=None):
        """The exit code, the lines after ctest's own, and stderr's."""
        environment = {name: value for name, value in os.environ.items()
                       if not name.startswith(("LOCVOL_", "CTEST_"))}
        if may_skip is not None:
            environment["LOCVOL_MAY_SKIP"] = may_skip
        with tempfile.TemporaryDirectory() as scratch:
            pathlib.Path(scratch, "CTestTestfile.cmake").write_text("".join(
                f'add_test({name} sh -c "{script}")\n'
                f'set_tests_properties({name} PROPERTIES {skips})\n'
                for name, script, skips in tests))
            result = subprocess.run(
                [sys.executable, "-B", RUN_TESTS, scratch, *arguments], env=environment,
                capture_output=True, text=True)
        said = result.stdout.partition("\nSkipped:\n")[2].splitlines()
        errors = [line for line in result.stderr.splitlines() if line.startswith("locvol:")]
        return result.returncode, said, errors

    def test_says_nothing_where_nothing_was_skipped(self):
        self.assertEqual(self.run_tests(PASSES), (0, [], []))
        self.assertEqual(self.run_tests(PASSES, may_skip="^$"), (0, [], []))

    def test_gives_each_reason_once(self):
        self.assertEqual(
            self.run_tests(no_models("a"), PASSES, NO_CCX, no_models("b"), SILENT),
            (0, ["  2 tests: needs models. To run it: MODELS=DIR",
                 "  no_ccx: needs ccx. To run it: install ccx",
                 "  silent: no reason given"], []))

    def test_tells_cases_of_a_process_of_many(self):
        self.assertEqual(
            self.run_tests(suite_of("tools/Several"), suite_of("tools/All/Others"), PASSES),
            (0, ["  2 tests: needs models. To run it: MODELS=DIR"], []))
        self.assertEqual(
            self.run_tests(suite_of("tools/Several"), may_skip="needs ccx"),
            (1, ["  tools/Several.Second: needs models. To run it: MODELS=DIR"],
             ["locvol: error: must not be skipped here: tools/Several.Second"]))
        self.assertEqual(
            self.run_tests(suite_of("tools/Several"), may_skip="needs models")[0], 0)

    def test_a_skipped_case_hides_no_failure(self):
        self.assertEqual(self.run_tests(suite_of("tools/Several", 1)),
                         (8, ["  tools/Several.Second: needs models. To run it: MODELS=DIR"], []))

    def test_keeps_the_exit_code_of_ctest(self):
        self.assertEqual(self.run_tests(FAILS), (8, [], []))
        self.assertEqual(self.run_tests(FAILS, SILENT), (8, ["  silent: no reason given"], []))
        self.assertEqual(self.run_tests(FAILS, SILENT, may_skip="^$")[0], 8)

    def test_passes_arguments_on(self):
        self.assertEqual(self.run_tests(FAILS, NO_CCX, arguments=("-R", "ccx"))[:2],
                         (0, ["  no_ccx: needs ccx. To run it: install ccx"]))
        self.assertEqual(self.run_tests(FAILS, NO_CCX, arguments=("-N",)), (0, [], []))
        self.assertNotEqual(
            self.run_tests(PASSES, arguments=("-R", "none", "--no-tests=error"))[0], 0)

    def test_fails_where_a_test_must_not_be_skipped(self):
        models = no_models("models")
        self.assertEqual(self.run_tests(models, may_skip="needs models")[0::2], (0, []))
        self.assertEqual(self.run_tests(models, NO_CCX, may_skip="needs models")[0::2],
                         (1, ["locvol: error: must not be skipped here: no_ccx"]))
        self.assertEqual(self.run_tests(SILENT, may_skip="needs models")[0], 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
