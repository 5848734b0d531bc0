#!/usr/bin/env python3
"""Checks the structure of src/: no cycle between files, no import from a lower layer of an upper one,
no file much beyond 500 lines, no prose in comments beyond column 100. Also checks the names of tests.

Reads the paths `crate::…`, `super::…` and `self::…` of each file, outside its unit tests and comments,
and finds the file that defines each name, through re-exports (`pub use`). Re-exports themselves are
no dependencies: a mod.rs only shows what lies in its folder.
"""

import pathlib
import re
import sys
import unicodedata

# From the ground up. A module may import those of lower lines only, never one of its own line.
LAYERS = [
    ["words", "random"],
    ["estimator", "model", "notation", "files", "pipe"],
    ["rows", "messages", "robot"],
    ["sim"],
    ["node"],
    ["identify", "control"],
    ["config"],
    ["offline", "bus", "recording", "checkpoint", "studies"],
    ["report", "runner"],
    ["live"],
    ["service"],
]

SOURCE = pathlib.Path(__file__).resolve().parent.parent / "src"

# Lines of a file that is part of the product, and columns of a comment.
LINES, COLUMNS = 550, 100

# Kinds of evidence, see CONTRIBUTING.md, and where there are tests.
KINDS = ("regress_", "val_", "prop_", "ident_", "fault_", "replay_", "rt_", "e2e_")
TESTS = ("src", "tests", "gateway", "clients")


def module_of(file):
    """('rows', 'pointwise') of src/rows/pointwise.rs, ('rows',) of src/rows/mod.rs, () of src/lib.rs."""
    parts = file.relative_to(SOURCE).with_suffix("").parts
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


def code_of(file):
    """The text without comments, strings and unit tests."""
    text = re.sub(r"//.*", "", file.read_text())
    text = re.sub(r'"(?:[^"\\]|\\.)*"', '""', text)
    tests = re.search(r"#\[cfg\((?:all\()?test\b[^\n]*\]\s*(?:pub )?mod \w+ \{", text)
    return text[: tests.start()] if tests else text


def flat(tree, prefix=()):
    """All paths of a use tree such as `a::{b, c::{d as e, self}}`, with the name each is known by."""
    tree = tree.strip()
    inner = re.fullmatch(r"(.*?)\{(.*)\}", tree, re.S)
    if inner is None:
        path, _, alias = (part.strip() for part in tree.partition(" as "))
        parts = prefix + tuple(path.split("::"))
        parts = parts[:-1] if parts[-1] == "self" and len(parts) > 1 else parts
        yield parts, alias or parts[-1]
        return
    prefix += tuple(part for part in inner[1].strip().split("::") if part)
    depth, start = 0, 0
    body = inner[2] + ","
    for at, letter in enumerate(body):
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            if body[start:at].strip():
                yield from flat(body[start:at], prefix)
            start = at + 1


class Source:
    def __init__(self):
        self.code = {module_of(file): code_of(file) for file in sorted(SOURCE.rglob("*.rs"))}
        self.shown = {}  # (module, name) -> the path that a re-export stands for
        for module, code in self.code.items():
            for tree in re.findall(r"\bpub(?:\([^)]*\))? use ([^;]+);", code):
                for path, name in flat(tree):
                    self.shown[module, name] = self.absolute(module, path)

    def absolute(self, module, path):
        """The path from the root of the crate, or None if it leads out of the crate."""
        if path[0] == "crate":
            return path[1:]
        if path[0] == "self":
            return module + path[1:]
        if path[0] == "super":
            while path and path[0] == "super":
                module, path = module[:-1], path[1:]
            return module + path
        return module + path if module + path[:1] in self.code else None

    def file_of(self, path):
        """The module that defines what a path from the root names."""
        for _ in range(10):
            at = max((n for n in range(len(path) + 1) if path[:n] in self.code), default=0)
            if at == len(path) or (path[:at], path[at]) not in self.shown:
                return path[:at]
            path = (self.shown[path[:at], path[at]] or ()) + path[at + 1 :]
        return path

    def imports(self):
        """(module, module that it imports) -> the names, for all files."""
        found = {}
        for module, code in self.code.items():
            names = re.sub(r"\bpub(?:\([^)]*\))? use [^;]+;", "", code)
            paths = [path for tree in re.findall(r"\buse ([^;]+);", names) for path, _ in flat(tree)]
            names = re.sub(r"\buse [^;]+;", "", names)
            paths += [tuple(path.split("::")) for path in re.findall(r"\b(?:crate|super|self)(?:::\w+)+", names)]
            children = "|".join(child[-1] for child in self.code if child and child[:-1] == module)
            if children:
                paths += [tuple(p.split("::")) for p in re.findall(rf"(?<![\w:])(?:{children})(?:::\w+)+", names)]
            for path in paths:
                absolute = self.absolute(module, path)
                target = None if absolute is None else self.file_of(absolute)
                if target not in (None, (), module):
                    found.setdefault((module, target), set()).add(path[-1])
        return found


def cycles(edges):
    """Sets of modules that reach each other (strongly connected components, Tarjan)."""
    graph = {}
    for source, target in edges:
        graph.setdefault(source, []).append(target)
        graph.setdefault(target, [])
    order, low, stack, result = {}, {}, [], []

    def visit(node):
        order[node] = low[node] = len(order)
        stack.append(node)
        for target in graph[node]:
            if target not in order:
                visit(target)
            if target in stack:
                low[node] = min(low[node], low[target])
        if low[node] == order[node]:
            at = stack.index(node)
            if len(stack) - at > 1:
                result.append(sorted(stack[at:]))
            del stack[at:]

    for node in graph:
        if node not in order:
            visit(node)
    return result


def width(text):
    """Columns that a text takes: a combining character such as the hat of θ̂ takes none."""
    return sum(not unicodedata.combining(letter) for letter in text)


def untidy():
    """Files that are too long, and comments that are too wide; tables and displays may be wider."""
    for file in sorted(SOURCE.rglob("*.rs")):
        lines = file.read_text().splitlines()
        if file.name != "tests.rs" and len(lines) > LINES:
            yield f"src/{file.relative_to(SOURCE)} has {len(lines)} lines, {LINES} at most: cut it by what it is about"
        display = False
        for number, line in enumerate(lines, 1):
            comment = re.match(r"\s*//[/!]?\s*(.*)", line)
            if comment is None:
                display = False
            elif comment[1].startswith("```"):
                display = not display
            elif not display and not comment[1].startswith("|") and width(line) > COLUMNS:
                yield f"src/{file.relative_to(SOURCE)}:{number}: the comment takes {width(line)} columns, {COLUMNS} at most"


def misnamed():
    """Tests whose name does not begin with its kind of evidence; those that must be asked for may have any name."""
    for folder in TESTS:
        for file in sorted((SOURCE.parent / folder).rglob("*.rs")):
            for attributes, test in re.findall(r"#\[test\]((?:\s*#\[[^\]]*\])*)\s*fn (\w+)", file.read_text()):
                if "#[ignore" not in attributes and not test.startswith(KINDS):
                    yield f"{file.relative_to(SOURCE.parent)}: {test}: expected a name that begins with one of {', '.join(KINDS)}"


def main():
    name = lambda module: "::".join(module) or "lib"
    layer = {folder: floor for floor, folders in enumerate(LAYERS) for folder in folders}
    source = Source()
    edges = source.imports()
    problems = [*untidy(), *misnamed()]
    for folder in sorted({module[0] for module in source.code if module} - set(layer)):
        problems.append(f"src/{folder} has no layer: add it to LAYERS in .ci/structure.py and to docs/design.md")
    for (lower, upper), names in sorted(edges.items()):
        a, b = lower[0] if lower else "", upper[0]
        if a and a != b and layer.get(a, 0) <= layer.get(b, 0):
            problems.append(f"upward: {name(lower)} imports {', '.join(sorted(names))} of {name(upper)}")
    for circle in cycles(edges):
        problems.append("cycle: " + ", ".join(map(name, circle)))
        for (a, b), names in sorted(edges.items()):
            if a in circle and b in circle:
                problems.append(f"    {name(a)} -> {name(b)}: {', '.join(sorted(names))}")
    print("\n".join(problems), file=sys.stderr)
    print(f"{len(source.code)} files, {len(edges)} imports between them")
    sys.exit(bool(problems))


main()
