#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""options_test.py MANUAL: every option that the documentation names exists, and every key of a rig file that the guide shows.

MANUAL is the folder of the built man pages; the options of refield-studies are those of its sources. In a command, as a line of code or
between backquotes, an option must be one of that command; elsewhere, of any.
"""
import gzip
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9_-]*")
# Of all commands; of the libraries that test and measure, sysctl, oiiotool, CMake, pip and venv, Slurm and GNU parallel.
FOREIGN = set("""--benchmark_filter --gtest_filter --system --create --fill --component --install --prefix
    --no-build-isolation --system-site-packages --help --help-all --json --quiet --force
    --account --mem --name --jobs --sshlogin""".split())


def options_of_manual(folder):
    """{"refield relight": {"--light", ...}, ...}"""
    options = {}
    for page in sorted(folder.glob("*.1.gz")):
        text = re.sub(r"\\f[BIR]", "", gzip.decompress(page.read_bytes()).decode()).replace("\\-", "-")
        command = re.search(r"^\.SH SYNOPSIS\n([a-z -]+[a-z])", text, re.MULTILINE)[1]
        options[command] = set(OPTION.findall(text))
    return options


def options_of_studies():
    sources = "".join(path.read_text() for path in ROOT.glob("bench/studies/**/*.cpp"))
    return {"refield-studies": {"--help", *re.findall(r'"(--[a-z-]+)"', sources)}}


def options_of_scripts():
    """Of dev and of the scripts of studies and lint: what they name."""
    named = {str(path.relative_to(ROOT)): set(OPTION.findall(path.read_text()))
             for path in [ROOT / "dev", *ROOT.glob("bench/**/*.py"), *ROOT.glob("tests/lint/*.py")]}
    return named | {"./" + name: options for name, options in named.items()}


def commands_of(text):
    """Lines of code, continued ones joined, and code between backquotes."""
    code = re.sub(r" *\\\n *", " ", text)
    yield from (line.strip() for line in code.splitlines() if line.startswith("    "))
    yield from (span.replace("\n", " ") for span in re.findall(r"`([^`]+)`", text))


def faults_of(name, text, options):
    names = sorted(options, key=len, reverse=True)
    known = set().union(*options.values()) | FOREIGN
    for option in sorted(set(OPTION.findall(text)) - known):
        yield f"{name}: no command has the option {option}"
    for line in commands_of(text):
        for part in re.split(r"[|;]|&&| #", line):
            command = next((each for each in names if re.match(re.escape(each) + r"(?![\w-])", part.strip())), None)
            if command is None:
                continue
            for option in OPTION.findall(part):
                if option not in options[command] | FOREIGN:
                    yield f"{name}: '{command}' has no option {option}: {line}"


def keys_of(lines):
    """(section, key) of rig files, also in comments."""
    section = None
    for line in lines:
        header, key = re.match(r"(?:# )?\[(\w+)\]", line), re.match(r"(?:# )?(\w+) = ", line)
        if header or not line:
            section = header and header[1]
        elif key and section:
            yield section, key[1]


def key_faults_of(name, text, known):
    """The sections that the file of 'refield acquire devices -o' has; those of scenes share names, but stand on other pages."""
    code = [line[4:] if line.startswith("    ") else "" for line in text.splitlines()]
    for section, key in keys_of(code):
        if section in {section for section, _ in known} - {"controls"} and (section, key) not in known:
            yield f"{name}: rig files have no key {key} in [{section}]"


def main():
    manual = pathlib.Path(sys.argv[1])
    options = options_of_manual(manual) | options_of_studies() | options_of_scripts()
    assert "--light" in options["refield relight"] and "--mode" in options["refield estimate"], options.keys()
    assert "--sky" in options["refield-studies"]
    assert list(faults_of("self-test", "    refield relight --no-such", options)), "the test finds nothing"
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/**/*.md"))]
    faults = [fault for page in pages for fault in faults_of(page.relative_to(ROOT), page.read_text(), options)]
    template = (ROOT / "cli/acquire/rig.toml").read_text()
    keys = {*keys_of(template.splitlines()), ("camera", "device"), ("camera", "trigger")}
    assert list(key_faults_of("self-test", "    [camera]\n    # window = 1", keys)), "the test finds no keys"
    for page in [*ROOT.glob("docs/guide/*.md"), ROOT / "docs/reference/devices.md"]:
        faults += key_faults_of(page.relative_to(ROOT), page.read_text(), keys)
    print("\n".join(faults) or f"{len(pages)} pages")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
