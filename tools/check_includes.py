"""Checks the arrows between source files: what #include lines say of the architecture.

Usage: check_includes.py [ROOT]     exit code 1 if there is any of these, each of which is printed:
  - a cycle of folders: engine/ and engine/run/ are two;
  - a cycle of units: x.h and x.cpp are one;
  - an arrow up, or across, in the layers: what is in a folder of the top level includes that folder
    and those of the layers below it.
"""

import collections
import pathlib
import re
import sys

LAYERS = [{"octree"}, {"storage", "refine"}, {"engine"}, {"tools"}, {"tests"}]  # from the bottom
INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)


def arrows(root):
    """All includes of one file of the repository by another, as pairs of paths, in order."""
    files = [path for layer in LAYERS for folder in layer for path in (root / folder).rglob("*")
             if path.suffix in (".h", ".cpp")]
    for path in sorted(files):
        for included in INCLUDE.findall(path.read_text()):
            if (root / included).is_file():
                yield path.relative_to(root), pathlib.PurePath(included)


def graph_of(includes, node_of):
    """By node, the nodes that it has arrows to, each with the first include that makes it one."""
    graph = collections.defaultdict(dict)
    for source, target in includes:
        if node_of(source) != node_of(target):
            graph[node_of(source)].setdefault(node_of(target), (source, target))
    return graph


def shortest_cycle(graph, start):
    """The nodes of a shortest cycle through `start`, which is its first and its last; or None."""
    before = {start: None}
    queue = collections.deque([start])
    while queue:
        node = queue.popleft()
        for following in graph.get(node, ()):
            if following == start:
                cycle = [start]
                while node is not None:
                    cycle.append(node)
                    node = before[node]
                return cycle[::-1]
            if following not in before:
                before[following] = node
                queue.append(following)
    return None


def cycles(graph):
    """A shortest cycle for each node that is in any, but none whose nodes are all in one before."""
    seen = []
    for node in sorted(graph):
        cycle = shortest_cycle(graph, node)
        if cycle and not any(set(cycle) <= nodes for nodes in seen):
            seen.append(set(cycle))
            yield cycle


def findings(root):
    includes = list(arrows(root))
    for name, node_of in (("folders", lambda path: path.parent.as_posix()),
                          ("units", lambda path: path.with_suffix("").as_posix())):
        graph = graph_of(includes, node_of)
        for cycle in cycles(graph):
            yield f"cycle of {name}: {' -> '.join(cycle)}"
            for source, target in zip(cycle, cycle[1:]):
                yield "  {} includes {}".format(*graph[source][target])
    height = {folder: i for i, layer in enumerate(LAYERS) for folder in layer}
    for source, target in includes:
        if source.parts[0] != target.parts[0] and height[source.parts[0]] <= height[target.parts[0]]:
            yield f"arrow up: {source} includes {target}"


if __name__ == "__main__":
    found = list(findings(pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else
                                       pathlib.Path(__file__).parents[1])))
    print("\n".join(found or ["no cycle of folders or units, no arrow up"]))
    sys.exit(1 if found else 0)
