#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the manual of refield from what its --help-all prints: man pages, shell completion or Markdown.

usage: cli/manual.py PROGRAM FOLDER [--date YYYY-MM-DD]    man/*.1.gz, refield.bash, _refield
       cli/manual.py PROGRAM FOLDER --markdown             one page per command, and index.md
"""
import concurrent.futures
import gzip
import os
import re
import subprocess
import sys
from dataclasses import dataclass, field

@dataclass
class Option:
    names: list  # ["-o", "--output"], or one name without dashes for a positional argument
    value: str  # "TEXT", empty for a flag
    choices: list  # what the value must be one of
    is_repeated: bool
    text: str


@dataclass
class Verb:
    path: tuple  # () for refield itself, ("acquire", "run") for a verb of a group
    paragraphs: list  # of the description; examples and tables keep their line breaks and indentation
    usage: str
    groups: list = field(default_factory=list)  # (heading, [Option])
    verbs: list = field(default_factory=list)  # (name, first line of its description)
    footer: list = field(default_factory=list)

    def options(self):
        return [option for heading, options in self.groups for option in options if heading != "Arguments"]

    def positionals(self):
        return [option for heading, options in self.groups for option in options if heading == "Arguments"]


def option_of(head, text):
    name, _, value = head.partition(" ")
    is_repeated = value.endswith("...")
    value = value.removesuffix("...").strip()
    return Option(name.split(","), value, value.split("|") if "|" in value else [], is_repeated, text)


def parse(path, text):
    description, _, rest = text.partition("Usage: ")
    usage, _, rest = rest.partition("\n")
    verb = Verb(path, description.strip("\n").split("\n\n"), usage.strip())
    group, entries = "", []
    for number, line in enumerate(lines := rest.split("\n")):
        if line.endswith(":") and not line.startswith(" ") and lines[number + 1].startswith("  "):
            group, entries = line.removesuffix(":"), []
            verb.groups.append((group, entries))
        elif line and not line.startswith(" "):  # the text at the end
            verb.footer = "\n".join(lines[number:]).strip().split("\n\n")
            break
        elif line.startswith("   "):
            entries[-1][1].append(line.strip())
        elif line:
            head, *part = re.split(r" {2,}", line.strip(), maxsplit=1)
            entries.append((head, part))
    # Of commands, which have no dashes and stand in groups of their own.
    is_verb = {group: group != "Arguments" and not entries[0][0].startswith("-") for group, entries in verb.groups}
    verb.verbs = [(head, " ".join(parts)) for group, entries in verb.groups if is_verb[group] for head, parts in entries]
    verb.groups = [(group, [option_of(head, " ".join(parts)) for head, parts in entries])
                   for group, entries in verb.groups if not is_verb[group]]
    return verb


def read_verbs(program, flag="--help-all"):
    """All verbs of the program, parents before their children, in the order of its help."""
    def read(path):
        done = subprocess.run([program, *path, flag], check=True, capture_output=True, text=True)
        return parse(path, done.stdout)

    found = [read(())]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        level = found
        while level:
            level = list(pool.map(read, [verb.path + (name,) for verb in level for name, _ in verb.verbs]))
            found += level
    order = {verb.path: verb for verb in found}

    def walk(path):
        yield order[path]
        for name, _ in order[path].verbs:
            yield from walk(path + (name,))
    return list(walk(()))


def is_literal(paragraph):
    return any(line.startswith(" ") for line in paragraph.split("\n"))


def value_of(option):
    return "|".join(option.choices) or option.value


# ---- man pages


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"^([.'])", r"\\&\1", text, flags=re.M)


def man_page(verb, verbs, version, date):
    name = "-".join(("refield",) + verb.path)
    summary = re.split(r"\.(?: |$)", verb.paragraphs[0].replace("\n", " "))[0]
    summary = re.sub(r"^refield ", "", summary)
    lines = [f'.TH "{name.upper()}" 1 "{date}" "refield {version}" "Reflectance fields"', ".nh", ".ad l",
             ".SH NAME", f"{roff(name)} \\- {roff(summary[0].lower() + summary[1:])}",
             ".SH SYNOPSIS", roff(verb.usage)]

    def add_paragraphs(paragraphs):
        for paragraph in paragraphs:
            if not lines[-1].startswith(".SH"):
                lines.append(".PP")
            if not is_literal(paragraph):
                lines.append(roff(paragraph))
                continue
            literal = False
            for line in paragraph.split("\n"):
                if line.startswith(" ") != literal:
                    literal = not literal
                    lines.append(".EX" if literal else ".EE")
                lines.append(roff(line))
            if literal:
                lines.append(".EE")

    lines.append(".SH DESCRIPTION")
    add_paragraphs(verb.paragraphs)
    for heading, options in verb.groups:
        lines.append(".SH ARGUMENTS" if heading == "Arguments" else
                     ".SH OPTIONS" if heading == "Options" else f".SS {roff(heading)}")
        for option in options:
            names = ", ".join(f"\\fB{roff(n)}\\fR" for n in option.names)
            value = f" \\fI{roff(value_of(option))}\\fR" if option.value and option.names[0][0] == "-" else ""
            note = " (repeatable)" if option.is_repeated else ""
            lines.extend([".TP", f"{names}{value}{note}", roff(option.text)])
    if verb.verbs:
        lines.append(".SH COMMANDS")
        for child, text in verb.verbs:
            lines.extend([".TP", f"\\fB{roff(name)}\\-{roff(child)}\\fR(1)", roff(text)])
    status = [p for p in verb.footer if p.startswith("Exit status:")]
    add_paragraphs([p for p in verb.footer if p not in status])
    if status:
        lines.extend([".SH EXIT STATUS", roff(status[0].removeprefix("Exit status:").strip())])
    lines.extend([".SH FILES", "Paths of this page that begin with docs/ or datasets_synthetic/ are those of the source",
                  "tree; the Debian package installs them in /usr/share/doc/refield."])
    related = [()] if not verb.path else [verb.path[:-1]]
    related += [v.path for v in verbs if v.path[:-1] == verb.path[:-1] and v.path not in (verb.path, ())] if verb.path else []
    see = [f"\\fB{roff('-'.join(('refield',) + path))}\\fR(1)" for path in related if path != verb.path]
    if see:
        lines.extend([".SH SEE ALSO", ", ".join(see)])
    return "\n".join(lines) + "\n"


# ---- completion


def bash_completion(verbs):
    common = [name for option in verbs[0].options() for name in option.names if name in ("--json", "--quiet")]
    common += ["--help", "--help-all"]
    words, values, groups = [], [], []
    for verb in verbs:
        path = " ".join(verb.path)
        names = [n for option in verb.options() for n in option.names if n != "-h"]
        names += [n for n in common if n not in names]
        words.append(f'    "{path}") verbs="{" ".join(name for name, _ in verb.verbs)}"\n'
                     f'      options="{" ".join(names)}" ;;')
        groups += [f'"{path}"'] if path else []
        for option in verb.options():
            if option.value:
                pattern = "|".join(f'"{path} {n}"' for n in option.names)
                values.append(f'    {pattern}) takes_value=1 choices="{" ".join(option.choices)}" ;;')
    return f"""# Completion of refield for bash, made by cli/manual.py.
_refield() {{
  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}}
  local verb= word verbs= options= takes_value= choices= i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    word=${{COMP_WORDS[i]}}
    case "${{verb:+$verb }}$word" in
    {"|".join(groups)}) verb="${{verb:+$verb }}$word" ;;
    esac
  done
  case "$verb" in
{chr(10).join(words)}
  esac
  case "$verb $prev" in
{chr(10).join(values)}
  esac
  if [[ $takes_value ]]; then
    COMPREPLY=($(compgen -W "$choices" -- "$cur"))
  elif [[ $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$options" -- "$cur"))
  elif [[ $verb != "$prev" && $verb != *" $prev" && $verb ]]; then
    COMPREPLY=()  # files
  else
    COMPREPLY=($(compgen -W "$verbs" -- "$cur"))
  fi
}}
complete -o default -F _refield refield
"""


def zsh_completion(verbs):
    def quoted(text):
        return text.replace("'", "'\\''")

    def bracketed(text):
        return quoted(re.sub(r"([\[\]:\\])", r"\\\1", text))

    def action(option):
        if option.choices:
            return f"({' '.join(option.choices)})"
        return "_files" if option.value == "TEXT" else " "

    functions = []
    for verb in verbs:
        lines = []
        for option in verb.options():
            value = f":{option.value.lower()}:{action(option)}" if option.value else ""
            text = bracketed(re.split(r"(?<=[^.]{3})[.;](?: |$)", option.text)[0])
            if len(option.names) > 1:
                lines.append(f"'({' '.join(option.names)})'{{{','.join(option.names)}}}'[{text}]{quoted(value)}'")
            else:
                lines.append(f"'{'*' if option.is_repeated else ''}{option.names[0]}[{text}]{quoted(value)}'")
        if verb.path:
            lines += [f"'{name}[{text}]'" for name, text in
                      (("--json", "Print results and errors as JSON on standard output"),
                       ("--quiet", "Do not print progress on standard error"))]
        name = "_".join(("_refield",) + verb.path).replace("-", "_")
        if not verb.verbs:
            arguments = " \\\n    ".join(lines + ["'*:file:_files'"])
            functions.append(f"{name}() {{\n  _arguments \\\n    {arguments}\n}}\n")
            continue
        listed = "\n".join(f"    '{child}:{bracketed(text)}'" for child, text in verb.verbs)
        called = "\n".join(f"      {child}) {name}_{child.replace('-', '_')} ;;" for child, _ in verb.verbs)
        files = "\n      _files" if verb.positionals() else ""
        arguments = " \\\n    ".join(lines + ["'1: :->verb'", "'*:: :->rest'"])
        functions.append(f"""{name}() {{
  local state line curcontext=$curcontext
  local -a verbs=(
{listed}
  )
  _arguments -C \\
    {arguments}
  case $state in
    verb)
      _describe command verbs{files}
      ;;
    rest)
      case $line[1] in
{called}
      *) _files ;;
      esac
      ;;
  esac
}}
""")
    return "#compdef refield\n# Completion of refield for zsh, made by cli/manual.py.\n" + "\n".join(functions) + '\n_refield "$@"\n'


# ---- Markdown


def markdown_page(verb):
    def escaped(text):
        text = re.sub(r"([<>|*_`\[\]])", r"\\\1", text)
        return re.sub(r"\bdocs/((?:guide|reference|method)/[\w-]+\.md)", r"[\1](../../\1)", text)

    lines = [f"# refield {' '.join(verb.path)}".rstrip(), ""]
    for paragraph in verb.paragraphs + [verb.usage and "Usage:\n  " + verb.usage]:
        literal = [line for line in paragraph.split("\n") if line.startswith(" ")]
        prose = [line for line in paragraph.split("\n") if not line.startswith(" ")]
        lines += [escaped(" ".join(prose)), ""] + (["```text"] + [line[2:] for line in literal] + ["```", ""] if literal else [])
    for heading, options in verb.groups:
        lines += [f"## {escaped(heading)}", ""]
        for option in options:
            names = ", ".join(f"`{n}{' ' + value_of(option) if option.value and n[0] == '-' else ''}`" for n in option.names)
            lines += [names, f":   {escaped(option.text)}", ""]
    if verb.verbs:
        lines += ["## Commands", ""]
        for child, text in verb.verbs:
            link = "-".join(verb.path + (child,))
            lines += [f"[`refield {' '.join(verb.path + (child,))}`]({link}.md)", f":   {escaped(text)}", ""]
    lines += [line for paragraph in verb.footer for line in (escaped(paragraph), "")]
    return "\n".join(lines)


def main():
    arguments = sys.argv[1:]
    date = ""
    if "--date" in arguments:
        at = arguments.index("--date")
        date = arguments[at + 1]
        del arguments[at:at + 2]
    markdown = "--markdown" in arguments
    arguments = [a for a in arguments if a != "--markdown"]
    if len(arguments) != 2:
        sys.exit(__doc__.split("\n\n")[1])
    program, folder = arguments
    verbs = read_verbs(program)
    if markdown:
        os.makedirs(folder, exist_ok=True)
        for verb in verbs:
            with open(os.path.join(folder, ("-".join(verb.path) or "index") + ".md"), "w") as page:
                page.write(markdown_page(verb))
        return
    version = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout.split()[-1]
    man = os.path.join(folder, "man")
    os.makedirs(man, exist_ok=True)
    for old in os.listdir(man):
        os.remove(os.path.join(man, old))
    for verb in verbs:
        with open(os.path.join(man, "-".join(("refield",) + verb.path) + ".1.gz"), "wb") as file:
            # No time stamp and no name, so that equal pages are equal files.
            with gzip.GzipFile("", "wb", 9, file, 0) as page:
                page.write(man_page(verb, verbs, version, date).encode())
    for name, text in (("refield.bash", bash_completion(verbs)), ("_refield", zsh_completion(verbs))):
        with open(os.path.join(folder, name), "w") as file:
            file.write(text)


if __name__ == "__main__":
    main()
