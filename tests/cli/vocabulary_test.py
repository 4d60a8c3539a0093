#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""vocabulary_test.py PROGRAM [--list]: one name per meaning, and one meaning per name, over the command line, rig files, recipes and Python.

vocabulary.tsv holds every name with its meaning, its default and its places. A new option, key or parameter fails until it has a
row, so that whoever adds it reads the others; two rows with one meaning or one name fail, as do texts and defaults of one name that
differ between commands. --list prints what the program has, in the form of the table.
"""
import ast
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "cli"))
import manual  # noqa: E402

MAX_COMMANDS, MAX_TOP_LEVEL, MAX_OPTIONS, MAX_SHOWN = 22, 16, 200, 12
TOML = {"rig": ["cli/acquire/session_rig.cpp", "core/light/monitor_placement.cpp"],
        "recipe": ["simulate/tabletop/recipe.cpp", "simulate/geometry/scene_description.cpp"]}
KEY = re.compile(r'(?:\b(?:text|number|integer|integers|numbers|flag|seconds|triple|vector|pairs|enumerator|table|tables|rows'
                 r'|whole_number|choice(?:<[\w:]+>)?)\(|read_(?:path|pattern|colour)\(section, )"(\w+)"')


def literal(text):
    """A default that can be compared: a number or a word; None for sentences, nothing, and what a flag has."""
    text = str(text or "").strip().strip("'")
    if not re.fullmatch(r"[\w.+:-]+", text) or text in ("None", "True", "False", "none", "all", "detected", "white"):
        return None
    try:
        return f"{float(text):g}"
    except ValueError:
        return text


def of_program(verbs):
    """(name, place, default, text) of arguments and options."""
    for verb in verbs:
        for option in verb.positionals() + verb.options():
            name = option.names[-1].removeprefix("--").replace("-", "_")
            default = re.search(r"\(default: ([^);]*)", option.text)
            yield name, " ".join(verb.path) or "refield", literal(default and default[1]), re.split(r"[.;:(]|, with ", option.text)[0].strip()


def of_toml():
    for kind, files in TOML.items():
        for file in files:
            for key in KEY.findall((ROOT / file).read_text()):
                yield key, kind, None, None


def of_python():
    for file in sorted((ROOT / "python/refield").glob("[!_]*.py")) + [ROOT / "python/refield/__init__.py"]:
        for node in ast.parse(file.read_text()).body:
            functions = [node] if isinstance(node, ast.FunctionDef) else [
                part for part in node.body if isinstance(part, ast.FunctionDef)] if isinstance(node, ast.ClassDef) else []
            if node.__class__ in (ast.FunctionDef, ast.ClassDef) and node.name.startswith("_"):
                continue
            for function in functions:
                if function.name.startswith("_") and function.name != "__init__":
                    continue
                owner = (node.name if function.name == "__init__" else
                         function.name if function is node else f"{node.name}.{function.name}")
                arguments = function.args
                defaults = [None] * (len(arguments.args) - len(arguments.defaults)) + arguments.defaults + arguments.kw_defaults
                for argument, default in zip(arguments.args + arguments.kwonlyargs, defaults):
                    if argument.arg not in ("self", "cls"):
                        yield argument.arg, f"python {owner}", literal(default and ast.unparse(default)), None


def faults_of(found, table, options):
    """`found`: {name: [(place, default, text)]}; `table`: rows of name, meaning, default, places; `options`: names with dashes."""
    rows, meanings = {}, {}
    for name, meaning, default, places in table:
        if name in rows:
            yield f"{name}: has two rows, so two meanings"
        if meaning.lower() in meanings:
            yield f"{name} and {meanings[meaning.lower()]} have one meaning: {meaning}"
        # --exposures are times of a camera, --exposure is the brightness of a picture, as in any viewer.
        if name != "exposures" and {name, name.removesuffix("s")} <= options and name.endswith("s"):
            yield f"{name} and {name.removesuffix('s')}: two names that differ by an s"
        rows[name], meanings[meaning.lower()] = (default, places), name
    for name in sorted(set(found) | set(rows)):
        have = {place for place, _, _ in found.get(name, [])}
        listed = set(rows[name][1].split(", ")) if name in rows else set()
        for place in sorted(have - listed):
            yield f"{name}: vocabulary.tsv does not list it for '{place}'; does it mean the same there as elsewhere?"
        for place in sorted(listed - have):
            yield f"{name}: '{place}' has none"
        if name not in rows or name not in found:
            continue
        for place, default, _ in found[name]:
            if default is not None and default != rows[name][0]:
                yield f"{name}: the default is {rows[name][0]}, but {default} for '{place}'"
        texts = {text for _, _, text in found[name] if text}
        if len(texts) > 1 and name != "output":
            yield f"{name}: is explained in different ways: " + " | ".join(sorted(texts))


def main():
    verbs = manual.read_verbs(sys.argv[1])
    found = {}
    for name, place, default, text in [*of_program(verbs), *of_toml(), *of_python()]:
        places = found.setdefault(name, [])
        if place not in [known for known, _, _ in places]:
            places.append((place, default, text))
    if sys.argv[2:] == ["--list"]:
        for name, places in sorted(found.items()):
            defaults = sorted({default for _, default, _ in places if default})
            print(name, next((text for _, _, text in places if text), ""), " | ".join(defaults) or "-",
                  ", ".join(sorted({place for place, _, _ in places})), sep="\t")
        return 0
    lines = (ROOT / "tests/cli/vocabulary.tsv").read_text(encoding="utf-8").splitlines()
    table = [line.split("\t") for line in lines if line and not line.startswith("#")]
    options = {option.names[-1].removeprefix("--").replace("-", "_") for verb in verbs for option in verb.options()}
    faults = list(faults_of(found, table, options))
    broken = faults_of({**found, "fps": found["fps"] + [("view", "60", "Rate")]}, table + [["rate", table[0][1], "-", "view"]], options)
    assert len(list(broken)) >= len(faults) + 4, "the test finds nothing"

    commands = [verb for verb in verbs if verb.path and not verb.verbs]
    counts = {" ".join(verb.path): len(verb.options()) for verb in verbs}
    shown = {" ".join(verb.path): len(verb.options()) for verb in manual.read_verbs(sys.argv[1], "--help")}
    for verb in verbs[1:]:
        if not any("--json" in text and "--quiet" in text for text in verb.footer):
            faults.append(f"{' '.join(verb.path)}: --help does not mention --json and --quiet")
    for what, number, limit in (("commands", len(commands), MAX_COMMANDS), ("commands at the top level", len(verbs[0].verbs), MAX_TOP_LEVEL),
                                ("options", sum(counts.values()), MAX_OPTIONS),
                                *((f"options that '{verb} --help' shows", count, MAX_SHOWN) for verb, count in shown.items())):
        if number > limit:
            faults.append(f"{number} {what}, more than {limit}")
    for verb in commands:
        name = " ".join(verb.path)
        print(f"{name:20} {counts[name]:3} options, {shown[name]:2} shown")
    keys = sum(place in TOML for places in found.values() for place, _, _ in places)
    python = sum(place.startswith("python ") for places in found.values() for place, _, _ in places)
    print(f"{len(commands)} commands, {len(verbs[0].verbs)} at the top level; {sum(counts.values())} options; {keys} keys of TOML files; "
          f"{python} parameters in Python; {len(found)} names; {len(faults)} collisions or gaps")
    print("\n".join(faults), file=sys.stderr)
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
