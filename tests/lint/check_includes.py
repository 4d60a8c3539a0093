#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that no source repeats an include of the standard library, Eigen or oneTBB that a header of ours brings.

tests/lint/check_includes.py [--fix] [FOLDER ...]    with --fix: removes those lines

Sources name the headers of ours that they use. What these include in angle brackets is theirs to use, too, directly or through
others; so are core/base/errors.h and refield/run_context.h, which nearly every header of ours includes.
"""
import functools
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
FOLDERS = ["acquire", "cli", "core", "estimate", "library", "python", "relight", "simulate"]
INCLUDE = re.compile(r'^#include ([<"])([^>"]+)[>"][^\n]*\n', re.M)
EVERYWHERE = ("core/base/errors.h", "include/refield/run_context.h")


@functools.cache
def place_of(name, folder):
    """A header of ours by its path from the root; None for others."""
    return next((path for path in (name, f"include/{name}", f"cli/{name}", f"{folder}/{name}") if (root / path).is_file()), None)


@functools.cache
def includes(path):
    """(whether in angle brackets, name, place of ours or None) of each include of a file."""
    folder = str(pathlib.Path(path).parent)
    return [(bracket == "<", name, None if bracket == "<" else place_of(name, folder))
            for bracket, name in INCLUDE.findall((root / path).read_text(encoding="utf-8"))]


@functools.cache
def brought(path):
    """All that a header of ours includes, directly or through others of ours."""
    found, waiting = set(), [path]
    while waiting:
        for is_system, name, place in includes(waiting.pop()):
            what = name if is_system else place
            if what and what not in found:
                found.add(what)
                waiting += [] if is_system else [place]
    return found


def repeated(path):
    """Names that a file includes although another header of ours that it includes brings them."""
    ours = [place for _, _, place in includes(path) if place]
    for is_system, name, place in includes(path):
        others = [other for other in ours if other != place]
        if (is_system and any(name in brought(other) for other in ours)) or (
                place in EVERYWHERE and path not in EVERYWHERE and any(place in brought(other) for other in others)):
            yield name


def main():
    fix = "--fix" in sys.argv
    folders = [word for word in sys.argv[1:] if word != "--fix"] or FOLDERS
    names = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate", "--",
                            *(f"{folder}/*.{end}" for folder in folders for end in ("cpp", "h"))],
                           cwd=root, check=True, capture_output=True, text=True).stdout.split()
    complaints = {name: found for name in names if (root / name).is_file() and (found := list(repeated(name)))}
    for name, found in complaints.items():
        if fix:
            text = (root / name).read_text(encoding="utf-8")
            text = INCLUDE.sub(lambda line: "" if line[2] in found else line[0], text)
            head, mark, rest = text.partition("\nnamespace ")
            head = re.sub(r"\n{3,}", "\n\n", head).replace("#pragma once\n\n#include", "#pragma once\n#include", 1)
            (root / name).write_text(head + mark + rest, encoding="utf-8")
        else:
            print(f"{name}: repeats includes of headers that it includes: {', '.join(found)}; remove them "
                  "(tests/lint/check_includes.py --fix)", file=sys.stderr)
    return 1 if complaints and not fix else 0


if __name__ == "__main__":
    sys.exit(main())
