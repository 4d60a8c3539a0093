#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that every relative link of the project's Markdown files names a file and, after '#', one of its headings,
that every file of docs/ that a source, a message or a test names exists, and every file of the project that a document
names by its path (patterns with * must match one).

tests/lint/check_links.py [FILE...]    without arguments: all files that git knows
"""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]


def without_code(text):
    """The text with the content of fenced and indented code and of `code` blanked, so that lines keep their numbers."""
    text = re.sub(r"^```.*?^```", lambda match: re.sub(r"[^\n]", " ", match[0]), text, flags=re.M | re.S)
    text = re.sub(r"(?<=\n\n)(?: {4}.*\n|\n)+", lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    return re.sub(r"`[^`\n]*`", lambda match: " " * len(match[0]), text)


def anchors(text):
    """The anchors that GitHub makes of the headings."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    found = set()
    for heading in re.findall(r"^#{1,6} +(.*?) *$", text, flags=re.M):
        name = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = re.sub(r"[^\w\- ]", "", name).replace(" ", "-")
        anchor, count = name, 0
        while anchor in found:
            count += 1
            anchor = f"{name}-{count}"
        found.add(anchor)
    return found


def broken_links(path, text):
    for match in re.finditer(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"", without_code(text)):
        link = match[1] or match[2]
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name) if name else path
        line = text.count("\n", 0, match.start()) + 1
        if not target.exists():
            yield line, f"links to {link}, which does not exist"
        elif anchor and anchor not in anchors(target.read_text(encoding="utf-8")):
            yield line, f"links to {link}, but {target.name} has no such heading"


def broken_mentions(text):
    for match in re.finditer(r"\bdocs/[\w./-]+\.(?:md|py|png|svg)\b", text):
        if not (root / match[0]).exists():
            yield text.count("\n", 0, match.start()) + 1, f"names {match[0]}, which does not exist"


def broken_paths(text):
    for match in re.finditer(r"(?<![\w/.-])(?:acquire|bench|cli|cmake|core|datasets_synthetic|docs|estimate|include|python|relight|simulate|tests)"
                             r"/[\w*./-]+\.(?:cpp|h|py|sh|toml|md|tsv|cff|svg|png|mp4)\b", text):
        if not any(root.glob(match[0])):
            yield text.count("\n", 0, match.start()) + 1, f"names {match[0]}, which does not exist"


def main():
    names = sys.argv[1:] or subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate"],
        cwd=root, check=True, capture_output=True, text=True).stdout.split("\n")
    complaints = 0
    for name in names:
        path = root / name
        if not name or not path.is_file():
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found = list(broken_mentions(text))
        if path.suffix == ".md":
            found += broken_links(path, text)
            found += (complaint for complaint in broken_paths(text) if complaint not in found)
        for line, complaint in sorted(found):
            print(f"{name}:{line}: {complaint}", file=sys.stderr)
            complaints += 1
    return 1 if complaints else 0


sys.exit(main())
