#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The figures that pages state, and their one source, docs/figures.toml.

bench/studies/figures.py check                       every figure of a page has the value of docs/figures.toml (a part of the lint)
bench/studies/figures.py fill                        writes the values into the pages
bench/studies/figures.py measure GROUP... [--program REFIELD] [--studies REFIELD-STUDIES] [--work FOLDER]
                                            runs the commands of these groups and writes docs/figures.toml

In a page a comment names the numbers that stand before it, in their order: `0.0113 and 4e-4 <!-- demo.natural packed.error -->`.
The numbers counted are the last ones of the same paragraph or row of a table; a dash counts one that is no figure, and a
figure that is a list counts as its values; `demo.refined[0]` is one of them.
"""
import argparse
import csv
import datetime
import json
import pathlib
import re
import subprocess
import sys
import tomllib

root = pathlib.Path(__file__).resolve().parents[2]
source = root / "docs/figures.toml"
NUMBER = re.compile(r"(?<![\w.])\d+(?:[.:]\d+)*(?:e-?\d+)?")
MARKER = re.compile(r"<!--((?: (?:\w+\.\w+(?:\[\d\])?|-))+) -->")
META = {"command", "commit", "date", "device"}
TABLETOP = "datasets_synthetic/tabletop/recipe.toml"


def load():
    return tomllib.loads(source.read_text(encoding="utf-8")) if source.exists() else {}


def pages():
    return [root / "README.md", *sorted((root / "docs").rglob("*.md")), *sorted((root / "datasets_synthetic").rglob("*.md"))]


def visit(figures, page, used):
    """The page with the values of `figures`, and what is wrong in it."""
    text, complaints, done = page.read_text(encoding="utf-8"), [], 0
    parts = []
    for marker in MARKER.finditer(text):
        where = f"{page.relative_to(root)}:{text.count(chr(10), 0, marker.start()) + 1}"
        if not text[:marker.start()].rpartition("\n")[2].strip():
            complaints.append(f"{where}: a comment that begins a line ends the paragraph; move it to the line before")
        named = []  # (name, value) of each number
        for name in marker[1].split():
            group, key, index = re.fullmatch(r"(\w*)[.-](\w*)(?:\[(\d)\])?", name).groups()
            values = figures.get(group, {}).get(key) if name != "-" else ""
            if values is None or index and int(index) >= len(values):
                complaints.append(f"{where}: docs/figures.toml has no figure {name}")
                values = index = None
            used.add(f"{group}.{key}")
            values = values if isinstance(values, list) else [values]
            named += [(name, value) for value in (values if index is None else [values[int(index)]])]
        begin = max(done, text.rfind("\n\n", 0, marker.start()), text.rfind("\n|", 0, marker.start()))
        numbers = list(NUMBER.finditer(text, begin, marker.start()))[-len(named):]
        if len(numbers) < len(named):
            complaints.append(f"{where}: {len(named)} figures are named, but {len(numbers)} numbers stand before them")
            continue
        for (name, value), number in zip(named, numbers):
            if not value:
                continue
            if value != number[0]:
                complaints.append(f"{where}: {name} is {number[0]}; docs/figures.toml says {value}: run bench/studies/figures.py fill")
            parts += [text[done:number.start()], value]
            done = number.end()
    return "".join(parts) + text[done:], complaints


def check(figures, fill):
    used, complaints = set(), []
    for page in pages():
        text, found = visit(figures, page, used)
        if fill and text != page.read_text(encoding="utf-8"):
            page.write_text(text, encoding="utf-8")
            print(f"{page.relative_to(root)}: filled")
            found = visit(figures, page, used)[1]
        complaints += found
    for group, values in figures.items():
        for key in values.keys() - META:
            if f"{group}.{key}" not in used:
                complaints.append(f"docs/figures.toml: no page states {group}.{key}; remove it")
    print("\n".join(complaints), end="\n" if complaints else "", file=sys.stderr)
    return 1 if complaints else 0


# ---- measuring: functions of the programs and a work folder that return the values of their group


def shell(command):
    return subprocess.run(["bash", "-c", command], cwd=root, check=True, stdout=subprocess.PIPE, text=True).stdout


def text_of(value):
    """Errors to three digits that count, four decimals at most."""
    return f"{value:.4f}" if value < 0.1 else f"{value:.3f}"


def errors_of(compared):
    """Of `compare --json`, for natural light, bars and squares: whole picture and median pixel."""
    return [text_of(compared["held_out"][kind][key]) for kind in ("natural", "bar", "square") for key in ("relative_rmse", "median")]


def demo(use):
    """`./dev demo`, with the field of --mode fast besides."""
    if not (use.work / "session").exists():
        shell(f"{use.program} simulate {TABLETOP} --size 240x180 -o {use.work}/truth && "
              f"{use.program} acquire run {TABLETOP} --truth {use.work}/truth -o {use.work}/session")
    values = {}
    for mode in ("refined", "paper", "fast"):
        field = use.work / f"{mode}.rfield"
        if not field.exists():
            shell(f"{use.program} estimate {use.work}/session --mode {mode} -o {field}")
        compared = json.loads(shell(f"{use.program} compare {field} {use.work}/session --truth {use.work}/truth/transport.rfield --json"))
        values[mode] = errors_of(compared)
        if mode == "refined":
            values["percent"] = [f"{100 * float(value):.1f}" for value in values[mode][:2]]
    ratios = [float(paper) / float(refined) for paper, refined in zip(values["paper"], values["refined"])]
    values["times_smaller"] = [f"{value:.1f}" for value in (min(ratios[::2]), max(ratios[::2]))]
    values["percent_smaller"] = [f"{100 - 100 / value:.0f}" for value in (min(ratios[1::2]), max(ratios[1::2]))]
    return values


def chart(use):
    """Methods of estimation on the session of `demo`: 30, 90 and all 180 photographs."""
    if not (use.work / "chart/chart.csv").exists():
        shell(f"{use.studies} chart {use.work}/session --truth {use.work}/truth --kinds {TABLETOP} --methods ours,paper,ridge,cells "
              f"--images 30,90,180 --max-kernels 25 -o {use.work}/chart")
    values = {}
    with open(use.work / "chart/chart.csv", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["method"] == "ours" and row["setting"] != "default":
                continue
            name = f"{row['method']}_{row['images']}"
            values[name] = [*(text_of(float(row[key])) for key in ("natural", "natural_median", "bar", "bar_median")),
                            str(round(float(row["bytes_per_pixel"])))]
            if row["images"] == "180":
                values[f"{name}_square"] = [text_of(float(row[key])) for key in ("square", "square_median")]
    return values


def polynomial(use):
    """Models of polynomial viewers on the photographs of `demo`; of the harmonics the number of terms that is best on natural light."""
    lines = shell(f"PYTHONPATH={root}/build/release/python /usr/bin/python3 bench/studies/polynomial.py {use.work}/session "
                  f"--truth {use.work}/truth/transport.rfield").splitlines()
    models = {line["model"]: line for line in map(json.loads, lines)}
    best = min((line for name, line in models.items() if name.startswith("hsh")), key=lambda line: line["natural"])
    return {"hsh_terms": best["model"].removeprefix("hsh")} | {
        name: [*(text_of(line[key]) for key in ("natural", "natural_median", "bar", "bar_median")), str(line["bytes_per_pixel"])]
        for name, line in (("ptm", models["ptm"]), ("hsh", best))}


GROUPS = {"demo": (demo, "./dev demo; refield compare FIELD out/demo/session --truth out/demo/truth/transport.rfield"),
          "chart": (chart, f"refield-studies chart out/demo/session --truth out/demo/truth --kinds {TABLETOP} --images 30,90,180 --max-kernels 25"),
          "polynomial": (polynomial, "bench/studies/polynomial.py out/demo/session --truth out/demo/truth/transport.rfield")}


def write(figures):
    lines = ["# SPDX-License-Identifier: Apache-2.0",
             "# The figures that pages state: bench/studies/figures.py measures demo, chart and polynomial; the others are entered",
             "# from their commands. `commit` and `date` tell when a command was last run."]
    for group, values in figures.items():
        lines += ["", f"[{group}]"]
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]
    source.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=("check", "fill", "measure"))
    parser.add_argument("groups", nargs="*", choices=[[], *GROUPS])
    parser.add_argument("--program", default=root / "build/release/cli/refield")
    parser.add_argument("--studies", default=root / "build/release/bench/studies/refield-studies")
    parser.add_argument("--work", type=pathlib.Path, default=root / "out/demo")
    use = parser.parse_args()
    figures = load()
    if use.verb != "measure":
        return check(figures, use.verb == "fill")
    commit = shell("git log -1 --format=%h").strip()
    for group in use.groups or GROUPS:
        function, command = GROUPS[group]
        wanted = figures.get(group, {}).keys() - META
        measured = function(use)
        values = {key: value for key, value in measured.items() if not wanted or key in wanted}
        figures = {group: {"command": command, "commit": commit, "date": f"{datetime.date.today()}", **values},
                   **{name: figures[name] for name in figures if name != group}}
        write(figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
