#!/usr/bin/env python3
"""Measures whole runs of locvol, beside other meshers where they are there.

    run_benchmarks.py --locvol build/release/tools/locvol --peers DIR --threads 1,2 \\
        --cells 1M,4M bunny.ply sphere:50k
    run_benchmarks.py --locvol build/release/tools/locvol --scaling --cells 1M,10M,100M sphere:50k
    run_benchmarks.py --locvol build/release/tools/locvol --peers DIR --bodies --sizes 5%,2% \\
        polycrystal:30

A model is a surface file, or SHAPE:TRIANGLES or polycrystal:GRAINS, which `locvol generate` makes.
Tables go to standard output, progress to standard error. README.md beside this file says what the
columns mean.
"""
import argparse
import json
import os
import shutil
import sys
import tempfile

import figures
import meshers
from meshers import Failed

SMOOTH_PEERS = ("cgal-parallel", "cgal", "tetgen-fill", "hxt-fill")  # they know of no creases
FEATURE_PEERS = ("cgal-features-parallel", "cgal-features")  # of several bodies, too
PEERS = SMOOTH_PEERS + FEATURE_PEERS
ONE_THREAD = ("cgal", "tetgen-fill", "cgal-features")


def note(text):
    print(text, file=sys.stderr, flush=True)


class Model:
    """A surface and what locvol says of it."""

    def __init__(self, text, locvol, work):
        self.name = os.path.splitext(os.path.basename(text))[0]
        self.path = os.path.abspath(text)
        shape, _, num = text.partition(":")
        if num and not os.path.exists(text):
            self.name = text
            self.path = os.path.join(work, shape + (".ply" if shape == "polycrystal" else ".stl"))
            locvol.generate(shape, figures.parse_count(num), self.path)
        facts = locvol.info(self.path)
        self.volume = facts["volume"]
        low, high = facts["box"]["min"], facts["box"]["max"]
        self.smallest_side = min(b - a for a, b in zip(low, high))
        self.volumes = {body["name"]: body["volume"] for body in facts["bodies"]}

    def row(self, size, mesher, threads):
        return {"model": self.name, "size": size,
                "size_percent": 100 * size / self.smallest_side, "mesher": mesher.name,
                "threads": threads}


class Benchmark:
    def __init__(self, options, work):
        self.options = options
        self.work = work
        self.locvol = meshers.Locvol(program_at(options.locvol), work, options.timeout,
                                     options.memory, options.init, options.format,
                                     options.bodies)
        self.cgal = {
            is_parallel: meshers.CgalMesh3(self.peer("cgal_mesh3"), work, options.timeout,
                                           is_parallel)
            for is_parallel in (True, False)
        }
        features = [meshers.CgalFeatures(self.peer("cgal_features"), work, options.timeout,
                                         is_parallel, options.bodies)
                    for is_parallel in (True, False)]
        fillers = (meshers.TetGen(self.peer("tetgen", shutil.which("tetgen")), work,
                                  options.timeout),
                   meshers.GmshHxt(self.peer("gmsh", shutil.which("gmsh")), work,
                                   options.timeout))
        everyone = (self.locvol, *self.cgal.values(), *features, *fillers)
        self.meshers = [m for m in everyone if m is self.locvol or m.name in options.tools]
        self.rows = []

    def peer(self, name, elsewhere=None):
        path = self.options.peers and program_at(os.path.join(self.options.peers, name))
        return path or elsewhere

    def keep(self, rows):
        """Takes rows that are complete but for what follows from others."""
        for row in rows:
            if "error" in row:
                outcome = row["error"]
            else:
                row["tetrahedra_per_size3"] = (row["tetrahedra"] * row["size"] ** 3
                                               / row.pop("volume"))
                outcome = "%d tetrahedra, %.3g s" % (row["tetrahedra"], row["seconds"])
            note("  %s, %d thread(s): %s" % (row["mesher"], row["threads"], outcome))
        figures.add_ratios(rows)
        self.rows += rows
        if self.options.json:
            with open(self.options.json, "a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)

    # ---- Side by side with peers ----

    def compare(self, model, size):
        """One row for each mesher and number of threads; the repetitions take turns."""
        jobs = [(mesher, threads) for threads in self.options.threads for mesher in self.meshers
                if threads == 1 or mesher.name not in ONE_THREAD]
        fillers = [job for job in jobs if isinstance(job[0], meshers.Filler)]
        runs, errors = {job: [] for job in jobs}, {}
        for job in jobs:
            if job not in fillers:
                self.run_once(model, size, job, runs, errors)
        self.prepare(model, size, fillers, runs, errors)
        for job in fillers:
            self.run_once(model, size, job, runs, errors)
        for _ in range(1, self.options.repetitions):
            for job in jobs:
                self.run_once(model, size, job, runs, errors)
        self.keep([summary(model.row(size, *job), runs[job], errors.get(job), model.volume)
                   for job in jobs])

    def run_once(self, model, size, job, runs, errors):
        mesher, threads = job
        if job in errors:
            return
        try:
            if mesher.problem():
                raise Failed(mesher.problem())
            run = mesher.run(model.path, size, threads)
            if "volumes" in run:
                run["volume_error"] = figures.volume_error(run.pop("volumes"), model.volumes)
            runs[job].append(run)
        except Failed as failure:
            errors[job] = str(failure)

    def prepare(self, model, size, jobs, runs, errors):
        """The boundary that the fillers fill is that of CGAL's mesh; they are to make as many
        tetrahedra as locvol."""
        mine = [run for (mesher, _), some in runs.items() if mesher is self.locvol for run in some]
        boundary = os.path.join(self.work, "boundary.off")
        meshers.remove(boundary)
        threads = max(self.options.threads)
        for filler in dict.fromkeys(mesher for mesher, _ in jobs):
            try:
                if filler.problem():
                    raise Failed(filler.problem())
                if not mine:
                    raise Failed("no run of locvol to be compared with")
                if not os.path.exists(boundary):
                    self.make_boundary(model, size, threads, boundary)
                filler.prepare(boundary, model.volume, mine[0]["tetrahedra"], threads)
            except Failed as failure:
                errors.update((job, str(failure)) for job in jobs if job[0] is filler)

    def make_boundary(self, model, size, threads, path):
        if self.cgal[True].problem():
            raise Failed("no boundary to fill: " + self.cgal[True].problem())
        try:
            self.cgal[True].run(model.path, size, threads, boundary=path)
        except Failed as failure:
            raise Failed("no boundary to fill: cgal: " + str(failure)) from failure
        if not os.path.exists(path):
            raise Failed("no boundary to fill: cgal wrote none")

    # ---- Sizes ----

    def sizes(self, model):
        """From --sizes as they are; from --cells those at which CGAL, or locvol where CGAL is not
        there or does not take bodies, makes so many tetrahedra."""
        if self.options.sizes:
            return [figures.parse_size(text, model.smallest_side) for text in self.options.sizes]
        is_alone = self.options.bodies or self.cgal[True].problem()
        counter = self.locvol if is_alone else self.cgal[True]
        counts = self.count_model(model, counter, min(self.options.cells))
        return [counts.size(cells) for cells in self.options.cells]

    def count_model(self, model, mesher, cells):
        """Of two coarse runs, far below `cells`."""
        samples = []
        size = (4.5 * model.volume / max(cells / 30, 500)) ** (1 / 3)  # to begin with
        for count in (None, max(cells / 5, 3000)):
            if count:
                size = min(figures.CountModel(samples).size(count), samples[0][0] / 1.5)
            run = mesher.run(model.path, size, max(self.options.threads))
            samples.append((size, run["tetrahedra"]))
        note("%s: %s makes %d tetrahedra at λ = %.4g, %d at %.4g"
             % (model.name, mesher.name, samples[0][1], samples[0][0], samples[1][1],
                samples[1][0]))
        return figures.CountModel(samples)

    # ---- Time and memory against the number of tetrahedra ----

    def scale(self, model):
        threads = max(self.options.threads)
        counts = self.count_model(model, self.locvol, min(self.options.cells))
        samples, store_bytes = [], 20.0  # a tetrahedron, until a row has told
        for target in sorted(self.options.cells):
            size = counts.size(target)
            row = model.row(size, self.locvol, threads) | {"target": target}
            lack = self.lack_of_room(model, size, target * store_bytes)
            if lack:
                self.keep([row | {"error": lack, "is_skipped": True}])
                continue
            job, runs, errors = (self.locvol, threads), [], {}
            for _ in range(self.options.repetitions):
                self.run_once(model, size, job, {job: runs}, errors)
            row = summary(row, runs, errors.get(job), model.volume)
            self.keep([row])
            if "error" in row:
                continue
            samples.append((size, row["tetrahedra"]))
            if len(samples) > 1:
                counts = figures.CountModel(samples[-2:])
            store_bytes = row["store_bytes"] / row["tetrahedra"]

    def lack_of_room(self, model, size, store_bytes):
        needed = 1.1 * (store_bytes + self.locvol.output_bytes(model.path, size))
        free = shutil.disk_usage(self.work).free
        if needed <= free:
            return None
        return ("skipped: needs about %.3g GB of disk, %.3g GB are free"
                % (needed / 1e9, free / 1e9))


def summary(row, runs, error, volume):
    """The row of several runs: the median in time, the largest in memory."""
    if error:
        return {**row, "error": error}
    median = figures.median_run(runs)
    return row | {"volume": volume} | median | {
        "peak_bytes": max(run["peak_bytes"] for run in runs),
        "runs": [run["seconds"] for run in runs]}


def program_at(path):
    return os.path.abspath(path) if os.access(path, os.X_OK) else None


def machine():
    """What the figures were measured on."""
    with open("/proc/cpuinfo") as file:
        names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return "%d × %s, %.3g GiB" % (os.cpu_count(), names[0] if names else "unknown", memory / 2**30)


def parse_options(arguments):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", metavar="MODEL")
    parser.add_argument("--locvol", default="build/release/tools/locvol", metavar="PROGRAM")
    parser.add_argument("--peers", metavar="DIR",
                        help="where cgal_mesh3 and cgal_features are, and tetgen and gmsh if not in "
                        "the PATH")
    parser.add_argument("--tools", type=lambda text: text.split(","), metavar="NAME,...",
                        help="peers to run: %s (default: the first %d, if there is --peers)"
                        % (", ".join(PEERS), len(SMOOTH_PEERS)))
    parser.add_argument("--bodies", action="store_true",
                        help="each model has several bodies: PLY as `locvol generate polycrystal` "
                        "writes it; peers: %s" % ", ".join(FEATURE_PEERS))
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--sizes", type=lambda text: text.split(","), metavar="SIZE,...",
                      help="λ: a length, or a percentage of the smallest side (2%%)")
    size.add_argument("--cells", metavar="N,...", type=parse_counts,
                      help="tetrahedra that CGAL makes, locvol with --scaling or without CGAL "
                      "(1M): λ is found by coarse runs")
    parser.add_argument("--scaling", action="store_true",
                        help="locvol alone, time and memory against the number of tetrahedra")
    parser.add_argument("--threads", default="1", type=parse_counts, metavar="N,...")
    parser.add_argument("--memory", metavar="SIZE", help="as for locvol")
    parser.add_argument("--init", default="cover", choices=("cover", "paper"), help="as for locvol")
    parser.add_argument("--format", default="vtu", metavar="NAME",
                        help="that locvol writes (default: vtu)")
    parser.add_argument("--repetitions", default=3, type=int, metavar="N")
    parser.add_argument("--timeout", default=7200, type=float, metavar="SECONDS",
                        help="for one run of one mesher")
    parser.add_argument("--work", default=".", metavar="DIR",
                        help="where a directory for the meshes is made, and removed at the end")
    parser.add_argument("--json", metavar="FILE", help="append each row, one JSON object a line")
    options = parser.parse_args(arguments)
    if options.scaling and options.sizes:
        parser.error("--scaling goes with --cells")
    if options.repetitions < 1:
        parser.error("--repetitions must be at least 1")
    if program_at(options.locvol) is None:
        parser.error("no program %s: build it, or name it by --locvol" % options.locvol)
    known = FEATURE_PEERS if options.bodies else PEERS
    if options.tools is None:
        options.tools = () if not options.peers else known if options.bodies else SMOOTH_PEERS
    if options.scaling:
        options.tools = ()
    for name in options.tools:
        if name not in known:
            parser.error("unknown tool %s; there are %s" % (name, ", ".join(known)))
    return options


def parse_counts(text):
    return [figures.parse_count(part) for part in text.split(",")]


def run(options, work):
    """Returns whether locvol did all that was asked of it, but for want of disk."""
    benchmark = Benchmark(options, work)
    is_good = True
    try:
        for text in options.models:
            try:
                run_model(benchmark, text)
            except Failed as failure:
                note("%s: %s" % (text, failure))
                is_good = False
    except KeyboardInterrupt:
        note("interrupted: what was done is in the table")
        is_good = False
    print_tables(options, benchmark)
    return is_good and not any(row["mesher"] == "locvol" and "error" in row
                               and not row.get("is_skipped") for row in benchmark.rows)


def run_model(benchmark, text):
    model = Model(text, benchmark.locvol, benchmark.work)
    note("%s: smallest side %.6g, volume %.6g" % (model.name, model.smallest_side, model.volume))
    if benchmark.options.scaling:
        benchmark.scale(model)
    else:
        for size in benchmark.sizes(model):
            benchmark.compare(model, size)


def print_tables(options, benchmark):
    print("%s; %s; medians of %d%s%s\n"
          % (machine(), benchmark.locvol.version(), options.repetitions,
             "; --memory " + options.memory if options.memory else "",
             ("; --init paper" if options.init == "paper" else "")
             + ("; --format " + options.format if options.format != "vtu" else "")))
    if options.scaling:
        print(figures.scaling_table(benchmark.rows))
        print("Exponents k, growth as the k-th power of the number of tetrahedra:\n")
        print(figures.exponent_table(benchmark.rows))
    else:
        print(figures.table(benchmark.rows))


def main(arguments=None):
    options = parse_options(arguments)
    options.locvol = program_at(options.locvol)
    if options.json:
        options.json = os.path.abspath(options.json)
    with tempfile.TemporaryDirectory(prefix="bench-", dir=os.path.abspath(options.work)) as work:
        return 0 if run(options, work) else 1


if __name__ == "__main__":
    sys.exit(main())
