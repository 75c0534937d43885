"""Numbers and tables of the benchmarks: pure functions, tested without a mesher."""
import math


def parse_count(text):
    """'20M' -> 20000000; k, M and G are powers of 1000. Raises ValueError."""
    factor = {"k": 1e3, "M": 1e6, "G": 1e9}.get(text[-1:], 1)
    count = float(text[:-1] if factor > 1 else text) * factor
    if not 1 <= count < math.inf:
        raise ValueError(text + " is no count")
    return round(count)


def count_text(count):
    """Three digits are enough for a title: 20000000 -> '20M'."""
    for factor, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if count >= 0.9995 * factor:
            return "%.3g%s" % (count / factor, unit)
    return "%d" % count


def parse_size(text, smallest_side):
    """'2%' of the smallest side of the bounding box, or a length. Raises ValueError."""
    if text.endswith("%"):
        size = float(text[:-1]) / 100 * smallest_side
    else:
        size = float(text)
    if not 0 < size < math.inf:
        raise ValueError(text + " is no size")
    return size


def median_run(runs):
    """The run with the median of the seconds, so that its phases add up to them.

    Of an even number it is the slower of the two in the middle.
    """
    return sorted(runs, key=lambda run: run["seconds"])[len(runs) // 2]


def exponent(n1, y1, n2, y2):
    """k of y = c n^k through two points; None where there is none."""
    if min(n1, n2, y1 or 0, y2 or 0) <= 0 or n1 == n2:
        return None
    return math.log(y2 / y1) / math.log(n2 / n1)


class CountModel:
    """Tetrahedra as a function of the size: n = a/size^3 + b/size^2.

    The first term is what the volume takes, the second what the surface does. Two samples
    determine both; from one, or where they contradict each other, only the first is taken.
    """

    def __init__(self, samples):
        *earlier, (size, count) = samples
        self.a, self.b = count * size**3, 0.0
        if earlier and earlier[-1][0] != size:
            size0, count0 = earlier[-1]
            # count * size^2 is linear in 1/size.
            slope = (count * size**2 - count0 * size0**2) / (1 / size - 1 / size0)
            if slope > 0:
                self.a, self.b = slope, count * size**2 - slope / size

    def count(self, size):
        return self.a / size**3 + self.b / size**2

    def size(self, count):
        """The size at which there are so many tetrahedra."""
        # In x = 1/size, a x^3 + b x^2 takes each positive value once, also if b < 0.
        low = high = (self.a / count) ** (1 / 3)
        while self.count(low) < count:
            low /= 2
        while self.count(high) > count:
            high *= 2
        for _ in range(100):
            middle = math.sqrt(low * high)
            if self.count(middle) < count:
                high = middle
            else:
                low = middle
        return math.sqrt(low * high)


def add_ratios(rows):
    """Gives each peer's row how much faster locvol is, with as many threads, on the same model
    and at the same size: in time, and in time per tetrahedron."""
    own = {row_key(row): row for row in rows if row["mesher"] == "locvol" and not row.get("error")}
    for row in rows:
        mine = own.get(row_key(row))
        if mine is None or row is mine or row.get("error"):
            continue
        row["ratio"] = row["seconds"] / mine["seconds"]
        row["ratio_per_tetrahedron"] = (row["ratio"] * mine["tetrahedra"] / row["tetrahedra"])


def row_key(row):
    return row["model"], row["size"], row["threads"]


def volume_error(volumes, true_volumes):
    """The largest of one body's, over its true volume; 1 of a body that is not there."""
    return max(abs(volumes.get(name, 0) / true - 1) for name, true in true_volumes.items())


PHASES = ("read", "cover", "refine", "write")

HEADER = ("model", "λ", "mesher", "threads", "tetrahedra", "total s",
          *(phase + " s" for phase in PHASES), "tetrahedra/s", "peak MiB", "store B/tet",
          "tets per λ³", "locvol faster by", "per tet by", "creases kept", "volumes off by", "note")

SCALING_HEADER = HEADER[:14] + ("note",)

EXPONENT_HEADER = ("model", "from", "to", "total", *PHASES, "peak memory")


def markdown(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    for row in rows:
        assert len(row) == len(header)
        cells = [str(cell).replace("|", "/").replace("\n", " ") for cell in row]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def shown(value, text):
    return "—" if value is None else text % value


def seconds_text(seconds):
    """Three digits, and no more than hundredths."""
    if seconds is None:
        return "—"
    return "%.*f" % (2 if seconds < 10 else 1 if seconds < 100 else 0, seconds)


def first_cells(row):
    return [row["model"], "%.4g%%" % row["size_percent"], row["mesher"], row["threads"]]


def figure_cells(row):
    n, phases = row["tetrahedra"], row["phases"]
    store = row.get("store_bytes")
    return (["{:,}".format(n), seconds_text(row["seconds"])]
            + [seconds_text(phases.get(phase)) for phase in PHASES]
            + ["{:,.0f}".format(n / row["seconds"]), "%.0f" % (row["peak_bytes"] / 2**20),
               shown(None if store is None else store / n, "%.1f"),
               "%.2f" % row["tetrahedra_per_size3"]])


def kept_text(row):
    """Of the length of creases, the part that is edges of the mesh: all of it, or to a thousandth
    of a percent, rounded down."""
    length, kept = row.get("crease_length"), row.get("kept_crease_length")
    if not length or kept is None:
        return "—"
    lost = max(0, 1 - kept / length)
    return "100%" if lost < 1e-9 else "%.3f%%" % (math.floor(1e5 * (1 - lost)) / 1e3)


def table(rows):
    """All rows in Markdown; a failed one says why in its note."""
    lines = []
    for row in rows:
        if row.get("error"):
            lines.append(first_cells(row) + ["—"] * 14 + [row["error"]])
        else:
            lines.append(first_cells(row) + figure_cells(row)
                         + [shown(row.get("ratio"), "%.2f×"),
                            shown(row.get("ratio_per_tetrahedron"), "%.2f×"), kept_text(row),
                            shown(row.get("volume_error"), "%.1g"), row.get("note", "")])
    return markdown(HEADER, lines)


def scaling_table(rows):
    lines = []
    for row in rows:
        if row.get("error"):
            expected = "about " + count_text(row["target"])
            lines.append(first_cells(row) + [expected] + ["—"] * 9 + [row["error"]])
        else:
            lines.append(first_cells(row) + figure_cells(row) + [row.get("note", "")])
    return markdown(SCALING_HEADER, lines)


def exponent_table(rows):
    """How time and memory grow from each row to the next of the same model."""
    good = [row for row in rows if not row.get("error")]
    lines = []
    for a, b in zip(good, good[1:]):
        if (a["model"], a["threads"]) != (b["model"], b["threads"]):
            continue
        pairs = [(a["seconds"], b["seconds"])]
        pairs += [(a["phases"].get(phase), b["phases"].get(phase)) for phase in PHASES]
        pairs += [(a["peak_bytes"], b["peak_bytes"])]
        n1, n2 = a["tetrahedra"], b["tetrahedra"]
        lines.append([a["model"], count_text(n1), count_text(n2)]
                     + [shown(exponent(n1, y1, n2, y2), "%.2f") for y1, y2 in pairs])
    return markdown(EXPONENT_HEADER, lines)
