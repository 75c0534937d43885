"""Runs ctest, then says which tests were skipped, why, and what would run them.

Usage: run_tests.py BUILD_DIRECTORY [ARGUMENTS OF ctest...]     the exit code is that of ctest
  LOCVOL_MAY_SKIP   a regular expression; a test that is skipped for a reason in which it is not
                    found counts as failed (exit code 1)

A test says why it is skipped in a line of its output: a script by "skipped: REASON", a test of
GoogleTest by GTEST_SKIP() << "REASON", also where it is one case of many in a process. The reason is a
few words, and what cures it: "needs ccx. To run it: COMMAND". Tests with the same reason share a line.
"""

import collections
import os
import pathlib
import re
import subprocess
import sys
import xml.etree.ElementTree

REASON = re.compile(r"^skipped: *(.+)$|: Skipped\n(.+)$", re.MULTILINE)
# What ctest keeps of the output of a test that passed: all of it, to find skipped cases in.
KEPT_BYTES = 64 << 20


def reason_of(output):
    found = REASON.search(output)
    return (found[1] or found[2]).strip() if found else "no reason given"


def skipped_cases(test, output):
    """The names and reasons of cases that a process of several skipped."""
    for part in output.split("[ RUN      ] ")[1:]:
        case, _, said = part.partition("\n")
        if f"[  SKIPPED ] {case} (" in said:
            suite = case.partition(".")[0]
            yield test.removesuffix(suite) + case, reason_of(said)


def skipped_tests(report):
    """The names of the skipped tests, by reason. Others that did not run have failed."""
    tests = collections.defaultdict(list)
    for test in xml.etree.ElementTree.parse(report).iter("testcase"):
        skipped = test.find("skipped")
        name, output = test.get("name"), test.findtext("system-out", "")
        if skipped is None:
            for case, reason in skipped_cases(name, output):
                tests[reason].append(case)
        elif skipped.get("message").startswith("SKIP_"):
            tests[reason_of(output)].append(name)
    return tests


def main(directory, *arguments):
    report = pathlib.Path(directory).resolve() / "tests.xml"
    report.unlink(missing_ok=True)
    command = ["ctest", "--test-dir", directory, "--output-junit", report,
               "--test-output-size-passed", str(KEPT_BYTES),
               "--test-output-size-failed", str(KEPT_BYTES), *arguments]
    exit_code = subprocess.run(command).returncode
    if not report.exists():  # nothing ran
        return exit_code
    tests = skipped_tests(report)
    if tests:
        print("\nSkipped:")
    for reason, names in tests.items():
        print(f"  {names[0] if len(names) == 1 else f'{len(names)} tests'}: {reason}")

    may_skip = os.environ.get("LOCVOL_MAY_SKIP")
    if may_skip is not None:
        wrong = [reason for reason in tests if not re.search(may_skip, reason)]
        for reason in wrong:
            print(f"locvol: error: must not be skipped here: {', '.join(tests[reason])}",
                  file=sys.stderr)
        exit_code = exit_code or int(bool(wrong))
    return exit_code


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
