#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Looks for the words of tests/lint/words.tsv, and for lines of Markdown over 110 columns.

tests/lint/check_words.py [PATH...]    all Markdown files, and the given files and folders

In Markdown, code blocks and `code` are not looked at, so that names of files, commands and options stay as they are.
In sources a line that ends in "words: exempt" is not looked at.
"""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
max_columns = 110


def read_words():
    words = {"text": [], "code": []}
    for line in (root / "tests/lint/words.tsv").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        scope, pattern, replacement = line.split("\t")
        for kind in words:
            if scope in (kind, "all"):
                words[kind].append((re.compile(pattern), replacement))
    return words


def without_code(text):
    """Markdown with code blocks, `code` and the targets of links blanked; lines keep their numbers."""
    def blank(match):
        return re.sub(r"[^\n]", " ", match[0])
    text = re.sub(r"^```.*?^```", blank, text, flags=re.M | re.S)
    text = re.sub(r"(?<=\n\n)(?: {4}.*\n|\n)+", blank, text)
    text = re.sub(r"`[^`]*`", blank, text)
    return re.sub(r"\]\([^)]*\)|<[^>]*>", blank, text)


def complaints(path, words):
    text = path.read_text(encoding="utf-8")
    markdown = path.suffix == ".md"
    if markdown:
        for number, line in enumerate(text.split("\n"), 1):
            columns = len(re.sub(r" *<!--.*?-->", "", line))  # names of figures are not shown
            if columns > max_columns:
                yield number, f"has {columns} columns, more than {max_columns}"
        text = without_code(text)
    for number, line in enumerate(text.split("\n"), 1):
        if not markdown and line.rstrip().endswith("words: exempt"):
            continue
        for pattern, replacement in words["text" if markdown else "code"]:
            for match in pattern.finditer(line):
                yield number, f"'{match[0].strip()}': write {replacement}"


def main():
    words = read_words()
    names = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate", "--",
         "*.md", *sys.argv[1:]],
        cwd=root, check=True, capture_output=True, text=True).stdout.split("\n")
    failed = False
    for name in filter(None, names):
        path = root / name
        if not path.is_file() or path.name == "words.tsv":
            continue
        try:
            found = list(complaints(path, words))
        except UnicodeDecodeError:
            continue
        for number, complaint in found:
            print(f"{name}:{number}: {complaint}", file=sys.stderr)
            failed = True
    return 1 if failed else 0


sys.exit(main())
