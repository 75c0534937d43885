"""The meshers that are compared: how each is called, and what it says of its run.

Every mesher has `name`, a method `problem()` that says why it cannot be run (None: it can), and
`run(surface, size, threads)`, which raises Failed or returns a dictionary: `tetrahedra`, `seconds`,
`cpu_seconds` (of the whole process where the mesher does not tell), `phases`, `peak_bytes`, and of
surfaces with creases, where it keeps any, `crease_length` and `kept_crease_length`; of several
bodies `volumes`, by name.
Memory is that of the child process as os.wait4 tells it. This process must stay small, files be
read in pieces: a child counts as at least as large as its parent has ever been.
"""
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import threading
import time


CREASES = ("crease_length", "kept_crease_length")
PATCHES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "patches.py")


class Failed(Exception):
    """A mesher that did not do what it was asked for; the text goes into its row."""


class Child:
    """One process, run to its end: `out`, `seconds`, `cpu_seconds`, `peak_bytes`. Raises Failed
    unless its exit code is one of `good_codes`."""

    def __init__(self, command, directory, timeout, good_codes=(0,)):
        paths = [os.path.join(directory, name) for name in ("stdout.txt", "stderr.txt")]
        with open(paths[0], "wb") as out, open(paths[1], "wb") as err:
            start = time.monotonic()
            try:
                process = subprocess.Popen(command, cwd=directory, stdout=out, stderr=err,
                                           stdin=subprocess.DEVNULL)
            except OSError as error:
                raise Failed("cannot be run: %s" % error.strerror) from error
            usage, is_late = wait(process, timeout)
            self.seconds = time.monotonic() - start
        self.cpu_seconds = usage.ru_utime + usage.ru_stime
        self.peak_bytes = usage.ru_maxrss * 1024
        with open(paths[0], errors="replace") as file:
            self.out = file.read()
        if is_late:
            raise Failed("took more than %g s" % timeout)
        if process.returncode not in good_codes:
            with open(paths[1], errors="replace") as file:
                raise Failed(failure_text(process.returncode, file.read() or self.out))


def wait(process, timeout):
    """Waits for the process, and kills it when its time is over."""
    is_late = threading.Event()

    def kill():
        is_late.set()
        process.kill()

    timer = threading.Timer(timeout, kill)
    timer.start()
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        process.wait()
        raise
    finally:
        timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage, is_late.is_set()


def failure_text(code, output):
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    status = "signal %d" % -code if code < 0 else "exit code %d" % code
    # Gmsh ends with a summary in a frame of dashes: the reason is the first error of its log.
    reasons = [line for line in lines if re.match(r"Error\s*:\s*\w", line)] or lines[-1:]
    return status + (": " + reasons[0][:200] if reasons else "")


class Mesher:
    def __init__(self, program, work, timeout):
        self.program = program  # None: not found
        self.work = work
        self.timeout = timeout

    def problem(self):
        if self.program is None:
            return self.name + " is not there"
        return None

    def child(self, arguments, good_codes=(0,)):
        return Child([self.program, *arguments], self.work, self.timeout, good_codes)


class Locvol(Mesher):
    name = "locvol"

    def __init__(self, program, work, timeout, memory=None, init="cover", format="vtu",
                 has_bodies=False):
        super().__init__(program, work, timeout)
        self.format = format
        self.surface_options = ["--bodies"] if has_bodies else []
        self.options = ["--init", init, "--format", format]
        if memory:
            self.options += ["--memory", memory]

    def run(self, surface, size, threads):
        output, store = (os.path.join(self.work, name) for name in ("locvol", "store"))
        files = [output, output + ".node", output + ".ele", store]
        remove(*files)
        command = ["mesh", surface, *self.surface_options, "-o", output, "--store", store,
                   "--size", "%.17g" % size, "--threads", str(threads), "--json", "--quiet",
                   *self.options]
        try:
            child = self.child(command, good_codes=(0, 3))
            report = parsed(child.out)
            result = {"tetrahedra": report["written"]["num_cells"], "seconds": child.seconds,
                      "cpu_seconds": child.cpu_seconds, "phases": self.phases(report),
                      "peak_bytes": child.peak_bytes,
                      "store_bytes": disk_bytes(store), "volume": report["surface"]["volume"]}
            if report.get("crease_length"):
                result |= {key: report[key] for key in CREASES}
            if "bodies" in report["statistics"]:
                names = {body["id"]: body["name"] for body in report["bodies"]}
                result["volumes"] = {names[body["id"]]: body["volume"]
                                     for body in report["statistics"]["bodies"]}
            if report["num_unresolved"]:
                result["note"] = "%d unresolved sites" % report["num_unresolved"]
            return result
        except KeyError as error:
            raise Failed("its report has no %s" % error) from error
        finally:
            remove(*files)

    @staticmethod
    def phases(report):
        seconds = report["seconds_by_phase"]
        return {"read": seconds["ingest"], "cover": seconds["initialize"],
                "refine": seconds["refine"], "write": seconds["write"]}

    def version(self):
        return self.child(["--version"]).out.strip()

    def info(self, surface):
        """Facts of the surface: volume, area, box, bodies."""
        return parsed(self.child(["info", surface, *self.surface_options, "--json"]).out)

    def output_bytes(self, surface, size):
        """Of disk that the mesh will take, with temporary files."""
        info = self.child(["info", surface, *self.surface_options, "--size", "%.17g" % size,
                           "--format", self.format, "--json"])
        return parsed(info.out)["estimate"]["output_disk_bytes"]["high"]

    def generate(self, shape, count, path):
        what = "--grains" if shape == "polycrystal" else "--triangles"
        self.child(["generate", shape, what, str(count), "-o", path])


class CgalMesh3(Mesher):
    """CGAL Mesh_3 by the program cgal_mesh3, with the bounds of locvol: λ for circumradii and
    surface balls, 2 for radius-edge ratios. Seconds and memory are those it tells of itself up to
    the written mesh; the figures that it gathers then do not count against it."""

    title = "cgal"
    options = ("--seeds", "4")

    def __init__(self, program, work, timeout, is_parallel):
        super().__init__(program, work, timeout)
        self.is_parallel = is_parallel
        self.name = self.title + ("-parallel" if is_parallel else "")

    def run(self, surface, size, threads, boundary=None):
        command = [*self.surface_arguments(surface), "--lambda", "%.17g" % size, *self.options,
                   "-o", "cgal.vtu"]
        if self.is_parallel:
            command += ["--parallel", "--threads", str(threads)]
        if boundary:
            command += ["--surface-out", boundary]
        try:
            child = self.child(command)
            report = parsed(child.out)
            took = report["wall_s"]
            phases = {"read": took["load"] + took["tree"],
                      "refine": took["refine"] + took["optimize"], "write": took["write"]}
            return {"tetrahedra": report["n_tets"], "seconds": sum(phases.values()),
                    "cpu_seconds": sum(report["cpu_s"].values()), "phases": phases,
                    "peak_bytes": round(report["peak_rss_mb"]["write"] * 2**20),
                    **self.features(report)}
        except KeyError as error:
            raise Failed("its report has no %s" % error) from error
        finally:
            remove(os.path.join(self.work, "cgal.vtu"))

    def surface_arguments(self, surface):
        return [surface]

    def features(self, report):
        return {}


class CgalFeatures(CgalMesh3):
    """The same with protected creases, by the program cgal_features: edges on these up to 0.84 λ,
    which is what locvol's are. Of several bodies it gets patches, whose making does not count."""

    title = "cgal-features"
    options = ()

    def __init__(self, program, work, timeout, is_parallel, has_bodies=False):
        super().__init__(program, work, timeout, is_parallel)
        self.has_bodies = has_bodies

    def surface_arguments(self, surface):
        if not self.has_bodies:
            return [surface]
        patches = Child([sys.executable, "-B", PATCHES, surface, "patches"], self.work,
                        self.timeout)
        return patches.out.splitlines()

    def features(self, report):
        result = {key: report[key] for key in CREASES}
        if self.has_bodies:
            result["volumes"] = {"region " + body: volume
                                 for body, volume in report["volumes"].items()}
        return result


class Filler(Mesher):
    """Fills a boundary that is there already. Only its own time for meshing counts: no reading, no
    writing. It has no bound of λ: how many tetrahedra it makes is set by `parameter`."""

    def __init__(self, program, work, timeout):
        super().__init__(program, work, timeout)
        self.parameter = None

    def prepare(self, boundary, volume, target, threads):
        """Looks for the parameter with which there are about `target` tetrahedra."""
        self.convert(boundary)
        self.parameter = self.first_parameter(volume / target)
        for _ in range(6):
            count = self.run(None, None, threads)["tetrahedra"]
            if abs(count / target - 1) <= 0.05:
                break
            self.parameter *= max(1 / 8, min(8, (count / target) ** (1 / self.power)))


class TetGen(Filler):
    name = "tetgen-fill"
    power = 1  # there are as many tetrahedra as the volume over the parameter, the largest one's

    def convert(self, boundary):
        shutil.copyfile(boundary, os.path.join(self.work, "tetgen.off"))

    @staticmethod
    def first_parameter(mean_volume):
        return 2 * mean_volume

    def run(self, surface, size, threads):
        try:
            child = self.child(["-pYq2.0/0a%.20fkNEF" % self.parameter, "tetgen.off"])
        finally:
            remove(*(os.path.join(self.work, "tetgen.1" + end) for end in (".vtk", ".smesh")))
        seconds = number_after("Total running seconds:", child.out)
        seconds -= number_after("Output seconds:", child.out)
        return {"tetrahedra": int(number_after("Mesh tetrahedra:", child.out)), "seconds": seconds,
                "cpu_seconds": child.cpu_seconds, "phases": {"refine": seconds},
                "peak_bytes": child.peak_bytes}


class GmshHxt(Filler):
    name = "hxt-fill"
    power = 3  # the parameter is a length

    def convert(self, boundary):
        off_to_medit(boundary, os.path.join(self.work, "hxt.mesh"))

    @staticmethod
    def first_parameter(mean_volume):
        return (6 * 2**0.5 * mean_volume) ** (1 / 3)  # the edge of a regular tetrahedron

    def run(self, surface, size, threads):
        mesh, script = (os.path.join(self.work, "hxt" + end) for end in (".msh", ".geo"))
        with open(script, "w") as file:
            file.write('Merge "hxt.mesh";\nSurface Loop(1) = {1};\nVolume(1) = {1};\n'
                       "Mesh.MeshSizeExtendFromBoundary = 0;\n"
                       "Mesh.MeshSizeMin = %.17g;\nMesh.MeshSizeMax = %.17g;\n"
                       % (self.parameter, self.parameter))
        try:
            child = self.child(["-3", "-algo", "hxt", "-nt", str(threads), "-format", "msh41",
                                "-bin", "hxt.geo", "-o", "hxt.msh"])
            seconds = number_after("Done meshing 3D (Wall", child.out)
            return {"tetrahedra": count_tetrahedra(mesh), "seconds": seconds,
                    "cpu_seconds": child.cpu_seconds, "phases": {"refine": seconds},
                    "peak_bytes": child.peak_bytes}
        finally:
            remove(mesh, script)


def parsed(text):
    """The JSON that ends a program's output."""
    try:
        # Not a number in JSON, but as streams print what is none.
        return json.loads(re.sub(r"(?<=: )-?(inf|nan)\b", "null", text[text.index("{"):]))
    except ValueError as error:
        raise Failed("its report cannot be read: " + repr(text[:80])) from error


def number_after(words, text):
    found = re.search(re.escape(words) + r"\s*([\d.]+(?:e[+-]?\d+)?)", text)
    if not found:
        raise Failed("its report has no '%s'" % words)
    return float(found[1])


def remove(*paths):
    for path in paths:
        if os.path.isdir(path):
            shutil.rmtree(path)
        elif os.path.lexists(path):
            os.remove(path)


def disk_bytes(directory):
    return sum(entry.stat().st_blocks * 512 for entry in os.scandir(directory))


def off_to_medit(source, target):
    """Line by line, with the digits as they are: Gmsh reads no OFF, and rounds what it reads of
    other formats. REQUIRES: one vertex or triangle a line, as CGAL writes them."""
    with open(source) as file, open(target, "w") as out:
        lines = (line for line in file if line.strip() and not line.startswith("#"))
        try:
            if next(lines).strip() != "OFF":
                raise ValueError
            num_vertices, num_triangles = map(int, next(lines).split()[:2])
            out.write("MeshVersionFormatted 2\nDimension 3\nVertices\n%d\n" % num_vertices)
            for _ in range(num_vertices):
                out.write(" ".join(next(lines).split()[:3]) + " 0\n")
            out.write("Triangles\n%d\n" % num_triangles)
            for _ in range(num_triangles):
                corners = [int(v) + 1 for v in next(lines).split()[1:4]]
                out.write("%d %d %d 1\n" % tuple(corners))
            out.write("End\n")
        except (ValueError, TypeError, StopIteration) as error:
            raise Failed("the boundary is no OFF file of triangles") from error


MSH_NODES = {15: 1, 1: 2, 2: 3, 4: 4}  # point, line, triangle, tetrahedron
MSH_TETRAHEDRON = 4


def count_tetrahedra(path):
    """Those of a binary MSH 4.1 file: what Gmsh prints counts other elements, too."""
    try:
        with open(path, "rb") as file:
            skip_past(file, b"\n$Elements\n")
            num_blocks = struct.unpack("<4Q", file.read(32))[0]
            count = 0
            for _ in range(num_blocks):
                _, _, kind, num = struct.unpack("<iiiQ", file.read(20))
                file.seek(num * 8 * (1 + MSH_NODES[kind]), os.SEEK_CUR)
                count += num if kind == MSH_TETRAHEDRON else 0
            if not file.read(20).lstrip().startswith(b"$EndElements"):
                raise ValueError
            return count
    except (OSError, ValueError, KeyError, struct.error) as error:
        raise Failed("wrote no mesh that can be read") from error


def skip_past(file, mark):
    """In pieces, so that a large file takes no memory."""
    end = b""
    while piece := file.read(2**20):
        at = (end + piece).find(mark)
        if at >= 0:
            file.seek(at + len(mark) - len(end + piece), os.SEEK_CUR)
            return
        end = (end + piece)[-len(mark):]
    raise ValueError
