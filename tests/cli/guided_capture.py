#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Types the answers of a guided capture, from nothing to a relit picture, and checks what it leaves.

usage: guided_capture.py REFIELD [--recipe RECIPE] [--rig NAME] [--page PAGE] [--work FOLDER] [--findings] [-- OPTION...]

With --recipe the rig is the simulated one, in a temporary folder; otherwise the devices that are there are
used. OPTION are options of 'refield acquire guide'. Wrong answers are given on purpose, Ctrl-C is pressed at a
question, standard input ends at another, and the rig file is run again without questions. A part of the
transcript replaces that in PAGE (docs/guide/guided-capture.md). --findings: only the captures of a simulated
camera that is bumped and of a room light that is switched on."""
import argparse
import filecmp
import io
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import textwrap

try:
    import pexpect
except ImportError:
    print("pexpect is not installed (Debian: python3-pexpect)")
    sys.exit(77)

# A question stands at the end of what was printed; its default is in brackets.
QUESTION = re.compile(r"(?:\r\n|^)([^\r\n]*[^\r\n\s])(?: \[([^\]\r\n]*)\])?: $")
PATIENCE = 900


def check(holds, what):
    if not holds:
        sys.exit(f"guided_capture.py: {what}")


class Guide:
    """The program in a terminal of its own, and all that it printed."""

    def __init__(self, command, folder):
        self.log = io.StringIO()
        # What is typed is echoed in the middle of a picture, and so of a character.
        self.terminal = pexpect.spawn(command[0], command[1:], cwd=folder, encoding="utf-8", codec_errors="replace",
                                      timeout=PATIENCE, dimensions=(50, 66))
        self.terminal.logfile_read = self.log

    def question(self):
        """The next question; None when the program has ended."""
        if self.terminal.expect([QUESTION, pexpect.EOF]) == 1:
            return None
        return self.terminal.match.group(1).strip()

    def answer(self, text):
        self.terminal.sendline(text)

    def status(self):
        self.terminal.close()
        return self.terminal.exitstatus


def run(command, folder, answers, stop_at=None, how=None):
    """Answers questions by the words that they hold, Enter to others, until the end or `stop_at`."""
    guide = Guide(command, folder)
    left = {words: list(given) for words, given in answers.items()}
    attempts = 0
    while (question := guide.question()) is not None:
        if stop_at and stop_at in question:
            guide.terminal.sendintr() if how == "interrupt" else guide.terminal.sendeof()
            guide.terminal.expect(pexpect.EOF)
            break
        attempts += "Try again?" in question
        check(attempts < 10, f"it tries again and again\n{readable(guide.log.getvalue())}")
        given = next((replies.pop(0) for words, replies in left.items() if words in question and replies), "")
        guide.answer(given)
        if "live image" in question and given in ("", "yes"):
            # Enter ends it, but a camera that takes photographs shows one alone, and the display may still be busy.
            guide.terminal.expect(["sharpness [0-9.]+ .*sharpness [0-9.]+ ", r"Show it again\? \[no\]", r"Try again\? \[yes\]"])
            guide.answer("")
    status = guide.status()
    rest = {words: replies for words, replies in left.items() if replies}
    check(stop_at or not rest, f"questions that never came: {rest}\n{readable(guide.log.getvalue())}")
    return status, guide.log.getvalue()


def readable(log, folder=""):
    """What a terminal shows at last: without colours, and a picture as a line."""
    lines = []
    for line in log.replace("\r\n", "\n").split("\n"):
        line = re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", line)
        line = line.rstrip("\r").split("\r")[-1].rstrip().replace("▀", "\0").replace(folder, "")
        if line.endswith("^C") or line == "^D":
            line = line.replace("^C", "").replace("^D", "")
        if "\0" in line:
            line = "   ▒▒▒ picture ▒▒▒"
            if lines and "sharpness" in lines[-1]:
                lines.pop()
        if re.fullmatch(r"\d{3},\d{3}: No such file or directory", line):  # the virtual DSLR's driver
            continue
        if line and lines and lines[-1] == line:
            continue
        lines += textwrap.wrap(line, 106, subsequent_indent="      ", break_long_words=False) if line else [""]
    return "\n".join(lines).strip() + "\n"


def same_files(left, right):
    """Whether two sessions hold the same, to the byte; logs of the run have times."""
    names = sorted(str(p.relative_to(left)) for p in left.rglob("*") if p.is_file())
    others = sorted(str(p.relative_to(right)) for p in right.rglob("*") if p.is_file())
    return names == others and not any(filecmp.cmpfiles(left, right, names, shallow=False)[1:])


def write_page(page, text):
    begin, end = "<!-- transcript -->", "<!-- end of the transcript -->"
    old = page.read_text()
    check(begin in old, f"{page} has no '{begin}'")
    before, rest = old.split(begin, 1)
    page.write_text(before + begin + "\n\n```text\n" + text + "```\n\n" + end + rest.split(end, 1)[1])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("refield", type=pathlib.Path)
    parser.add_argument("--recipe", type=pathlib.Path)
    parser.add_argument("--rig", default="virtual")
    parser.add_argument("--page", type=pathlib.Path)
    parser.add_argument("--work", type=pathlib.Path)
    parser.add_argument("--findings", action="store_true")
    words = [*sys.argv[1:], "--"]
    given = parser.parse_args(words[: words.index("--")])
    given.options = words[words.index("--") + 1 : -1]
    with tempfile.TemporaryDirectory() as temporary:
        work = (given.work or pathlib.Path(temporary)).resolve()
        if given.findings:
            check_findings(given.recipe, work, str(given.refield.resolve()))
        else:
            check_guide(given, work, str(given.refield.resolve()))


def check_guide(given, work, refield):
    options = given.options
    is_virtual = given.recipe is not None
    if is_virtual:
        recipe = given.recipe.read_text()
        for key, count in {"train": 1, "natural": 1, "bars": 1, "squares": 0}.items():
            recipe = re.sub(rf"(?m)^{key} = .*", f"{key} = {count}", recipe)
        (work / "recipe.toml").write_text(recipe)
        subprocess.run([refield, "--quiet", "simulate", "recipe.toml", "-o", "truth"], cwd=work, check=True,
                       stdout=subprocess.DEVNULL)
        options = ["--camera", "virtual:recipe.toml", "--truth", "truth", *options]
    command = [refield, "acquire", "guide", "mug", *options]
    mug = work / "mug"

    # Without a terminal it asks nothing, and says so.
    piped = subprocess.run(command, cwd=work, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    check(piped.returncode == 2 and "--yes" in piped.stderr, f"without a terminal: {piped}")

    # Standard input ends at the first question after the devices; Ctrl-C comes at the number of patterns.
    # A wrong answer is refused with its reason and asked for again.
    status, log = run([*command[:3], "tea", *options], work, {}, "live image", "end")
    check(status == 130 and "The same command continues" in log, f"end of input: {status}\n{readable(log)}")
    tea = work / "tea"
    check((tea / "rig.toml").exists() and not (tea / "calibration.toml").exists(), "after the end of input")
    status, first = run(command, work, {"live image": ["yes"], "Show it again?": ["no"]}, "Number of patterns", "interrupt")
    check(status == 130 and (mug / "calibration.toml").exists(), f"Ctrl-C: {status}\n{readable(first)}")
    if is_virtual:
        check("light does not flicker" in first, f"highlights that clip are taken for flicker\n{readable(first)}")
    status, second = run(command, work, {"Number of patterns": ["7", "many", "36"], "Start the capture": ["perhaps"]})
    check(status == 0, f"the guided capture ended with status {status}\n{readable(second)}")
    for words in ("'7' is not valid", "'many' is not valid", "answer yes or no"):
        check(words in second, f"'{words}' was not said\n{readable(second)}")
    for name in ("session/session.toml", "scene.rfield", "relit.png"):
        check((mug / name).exists(), f"{name} is missing")
    check(len(list((mug / "lights").glob("*.exr"))) == 36 + 3 + 3, "36 patterns, three primaries, three times white")

    # The rig file runs again without questions, and so does the guide.
    again = (mug / "rig.toml").read_text().replace('output = "session"', 'output = "again"')
    (mug / "again.toml").write_text(again)
    subprocess.run([refield, "--quiet", "acquire", "run", "mug/again.toml"], cwd=work, check=True,
                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    photographs = [len(list((mug / session / "observed").glob("*.exr"))) for session in ("session", "again")]
    check(photographs[0] == photographs[1] >= 36, f"photographs of both sessions: {photographs}")
    if is_virtual:  # where noise is the same, too
        check(same_files(mug / "session", mug / "again"), "the session of the rig file differs")
    if is_virtual:  # a quick capture: 27 patterns and 3 primaries, a held-out one, and the error to expect
        (mug / "quick.toml").write_text(again.replace('"again"', '"quick"'))
        quick = subprocess.run([refield, "acquire", "run", "mug/quick.toml", "--quick"], cwd=work, capture_output=True, text=True)
        count = len(list((mug / "quick/illumination").glob("t*.exr")))
        check(quick.returncode == 0 and count == 28, f"quick capture: {count} patterns\n{quick}")
        check("after 30 photographs: predicted error" in quick.stderr, f"no error was predicted\n{quick.stderr}")
    unattended = subprocess.run([*command, "--yes"], cwd=work, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    check(unattended.returncode == 0 and "already complete" in unattended.stdout, f"unattended: {unattended}")

    if given.page:  # steps 3 to 6, without the wrong answers
        first, second = (readable(log, str(work) + "/") for log in (first, second))
        parts = [first[first.index("Step 3"):first.index("Number of patterns")],
                 second[second.rindex("Number of patterns"):second.index("check of")]]
        text = re.sub(r".*(\[yes\]: perhaps\n.* is not valid.*| took 0:.*)\n", "", "".join(parts))
        write_page(given.page, text)
    print(f"guided capture with the {given.rig} rig: {photographs[0]} photographs, relit.png written")


def check_findings(scene, work, refield):
    """The guide names a camera that was bumped, and a room light that was switched on, while something can still be done;
    here it goes on after a second try. The transcripts stay in the work folder."""
    (work / "small.toml").write_text(re.sub(r"(?m)^(width|height) = (\d+)",
                                            lambda size: f"{size[1]} = {int(size[2]) // (2 if int(size[2]) in (160, 120) else 4)}",
                                            scene.read_text()))
    subprocess.run([refield, "--quiet", "simulate", "small.toml", "--train", "1", "--test", "0,0,0",
                    "-o", "small"], cwd=work, check=True, stdout=subprocess.DEVNULL)
    for name, tables, words in (("bump", "[camera]\nmoves = [[0.3, 0.6, -0.4]]\n", "motion: "),
                                ("light", "[ambient]\nswitched = [[0.3, 8.0]]\n", "room light: ")):
        (work / f"{name}.toml").write_text('base = "small.toml"\n' + tables)
        command = [refield, "acquire", "guide", name, "--camera", f"virtual:{name}.toml", "--truth", "small", "--patterns", "72"]
        status, log = run(command, work, {"live image": ["no"], "Mend the cause": ["later", "again"]})
        log = readable(log, str(work) + "/")
        (work / f"{name}.txt").write_text(log)
        check(status == 0, f"the capture with a {name} ended with status {status}\n{log}")
        stop = log.find("the capture stopped after")
        check(0 < stop < log.find("Step 7"), f"the capture with a {name} did not stop\n{log}")
        check(words in log[stop:] and "'later' is not valid" in log, f"'{words}' was not said\n{log}")
        check("run " + name + "/rig.toml --force" in log, f"it was not photographed again\n{log}")
        check((work / name / "scene.rfield").exists(), f"{name}/scene.rfield is missing")
        print(f"guided capture with a {name}: named after the first {log[stop:].split()[4]} photographs")


main()
