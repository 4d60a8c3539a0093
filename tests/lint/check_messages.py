#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that docs/guide/troubleshooting.md, the index of messages, has every message of the program.

tests/lint/check_messages.py [--list]    with --list: prints all messages

A message is what a source passes to an error or a note; its fixed words are its literals, and '…' is what stands between
them. The index has it if an entry (*words* before the dash of an item) occurs in it: the parts of an entry between '…' in
their order. Each entry must occur in a message, or in another literal of the sources: some messages are put together before.
"""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
page = "docs/guide/troubleshooting.md"
CALLS = re.compile(r"\b(?:InputError|FormatError|DeviceError|SolverError|fail|refuse|require|complain|note|warn|"
                   r"(?:notes_?|warnings)\.push_back)\s*\(|^(?:static |inline )?(?:std::string|const char\*) \w*(?:text|remedy|reason|cause|advice|sentence)\w*\(.*\{$",
                   re.M)
LITERAL = re.compile(r'"((?:[^"\\\n]|\\.)*)"')


def end_of(text, begin):
    """The index behind the bracket that closes the one before `begin`."""
    depth, i = 1, begin
    while depth and i < len(text):
        if text[i] == '"':
            i = LITERAL.match(text, i).end() - 1 if LITERAL.match(text, i) else i
        depth += (text[i] in "({") - (text[i] in ")}")
        i += 1
    return i


def sources():
    names = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate", "--",
                            *(f"{folder}/*.{end}" for folder in ("core", "acquire", "estimate", "library", "relight", "simulate", "cli", "python") for end in ("cpp", "h", "py"))],
                           cwd=root, check=True, capture_output=True, text=True).stdout.split()
    for name in filter(lambda name: (root / name).is_file(), names):
        yield name, re.sub(r"^\s*//.*$", "", (root / name).read_text(encoding="utf-8"), flags=re.M)


def messages():
    """(file, line, message) of all calls that have literals of two words or more."""
    for name, text in sources():
        for call in CALLS.finditer(text):
            part = re.sub(r'"\s*\n?\s*"', "", text[call.end():end_of(text, call.end())])
            # The literals of a function that makes texts are one by one.
            found = LITERAL.findall(part)
            for message in found if call[0].endswith("{") else [" … ".join(found)]:
                if not re.search(r"%\.1f ms|<\w+ class=|std::", message) and len(re.findall(r"[A-Za-z]{2,}", message)) >= (3 if call[0].endswith("{") else 2):
                    yield name, text.count("\n", 0, call.start()) + 1, message.replace('\\"', '"').replace("\\n", " ")


def entries():
    for item in re.findall(r"^- (\*(?!\*).*?) —", (root / page).read_text(encoding="utf-8"), flags=re.M | re.S):
        yield from re.findall(r"\*([^*]+)\*", " ".join(item.split()))


def main():
    known = {entry: re.compile(".*".join(re.escape(part.strip()) for part in entry.split("…"))) for entry in entries()}
    used, complaints = set(), 0
    for name, line, message in messages():
        if "--list" in sys.argv:
            print(f"{name}:{line}: {message}")
            continue
        found = {entry for entry, pattern in known.items() if pattern.search(message)}
        used |= found
        if not found:
            print(f"{name}:{line}: {page} has no entry for: {message}", file=sys.stderr)
            complaints += 1
    others = "\n".join(re.sub(r'"\s*\n?\s*"', "", text) for _, text in sources()) if known.keys() - used else ""
    for entry in (entry for entry in known.keys() - used if "--list" not in sys.argv and not known[entry].search(others)):
        print(f"{page}: no message has the words: {entry}", file=sys.stderr)
        complaints += 1
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
