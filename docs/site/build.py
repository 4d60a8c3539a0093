#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Builds the documentation site from docs/, the program's --help, the C++ headers and the Python module.

usage: docs/site/build.py PROGRAM GALLERY SITE [PYTHON]

PROGRAM: refield. GALLERY: folder for the fields and films of the gallery, which are made once. SITE: folder to
write. PYTHON: folder that the Python module is imported from; without it the site has no page of it.
"""
import html.parser
import importlib
import inspect
import os
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.parse
import xml.etree.ElementTree as ElementTree

import mkdocs.commands.build
import mkdocs.config
import yaml

root = pathlib.Path(__file__).resolve().parents[2]

# The gallery: (title, text, commands that make it, picture, film or page). The commands of what lies in gallery/ are run as the
# page shows them; those of other pictures need files that the reader fetches, or made what docs/images has.
GALLERY = [
    ("Live: relight a captured scene",
     "Drag on the light map to move the light; click a pixel of the scene to see which light reaches it. This is the folder "
     "that [`refield export-web`](guide/web.md) writes, embedded in this page ([full window](gallery/page/index.html)).",
     ["refield simulate datasets_synthetic/tabletop/recipe.toml -o truth --size 240x180 --light-size 64x48 "
      "--train 90 --quality 3",
      "refield estimate truth -o table-top.rfield", "refield export-web table-top.rfield -o page"],
     "gallery/page/index.html"),
    ("A bar, a panorama, a day",
     "A field of 1024×768 pixels from 180 simulated photographs under a sliding bar, a turning panorama and a hazy day.",
     ["bench/studies/pictures.py fields OUT --env sunset.exr", "bench/studies/pictures.py film OUT film.webp"], "images/film.webp"),
    ("Held-out light, enlarged",
     "A mirror, a glass and a shadow edge: traced, the method of the paper, refield, and four times their errors.",
     ["bench/studies/pictures.py crops OUT crops.jpg"], "images/crops.jpg"),
    ("A scanned mesh in its environment",
     "The bunny of the Stanford 3D Scanning Repository, from Debian's package libcgal-demo, under a panorama of blender-data (CC0).",
     ["apt-get download libcgal-demo blender-data",
      "for package in *.deb; do dpkg -x $package .; done",
      "tar xzf usr/share/doc/libcgal-dev/data.tar.gz --strip-components=2 data/meshes/bunny00.off",
      "cp usr/share/blender/datafiles/studiolights/world/sunset.exr docs/examples/bunny.toml .",
      "refield precompute bunny.toml --resolution 256 -o bunny.rfield",
      "refield relight bunny.rfield --env sunset.exr --yaw 60 --show-environment --size 1024x768 -o bunny.png"], "images/bunny.jpg"),
    ("Moving objects and lights", "Objects, area lights and the camera move; the materials are glossy.",
     ["refield render datasets_synthetic/dynamic/room.toml -o room.mp4"], "images/dynamic-room.mp4"),
    ("Precomputed transport", "Meshes with soft and hard shadows and interreflection, from a moving camera during a day.",
     ["refield precompute datasets_synthetic/prt/small.toml -o small.rfield",
      "refield relight small.rfield --day --yaw 30 --turntable --frames 60 --fps 15 --size 640x480 -o turntable.mp4"],
     "gallery/turntable.mp4"),
    ("Environments", "One captured scene in several environments. [Relighting](guide/relighting.md)", [], "images/environments.jpg"),
    ("Viewer: the kernels of a pixel", "A click on a pixel shows the light that contributes to it. [Viewer](guide/viewer.md)",
     ["refield view table-top.rfield"], "images/viewer-kernels.jpg"),
    ("Viewer: a mesh under a panorama", "The camera orbits; a click shows the kernels of a vertex.",
     ["refield view bunny.rfield --light sunset.exr"], "images/viewer-mesh.jpg"),
    ("Viewer: a moving scene", "Objects and lights follow the mouse. [Dynamic scenes](guide/dynamic-scenes.md)",
     ["refield view datasets_synthetic/dynamic/room.toml"], "images/viewer-scene.jpg"),
    ("The report on its error",
     "One file with held-out photographs, predictions, charts and the kernels of single pixels: "
     "[open the report](gallery/report.html), [how to read it](guide/report.md).",
     ["refield compare table-top.rfield truth --truth truth -o report.html"], None),
    ("A light stage: real photographs",
     "96 photographs of a statuette, one light source each (DiLiGenT), become a field that any environment lights "
     "([import](guide/import.md#domes-and-light-stages)). The photographs are not free to copy, so there is no picture here.",
     ["git clone https://github.com/BelabdiMalak/Photometric_3D_Reconstruction cat",
      "refield acquire import cat/data --light-sources cat/data/light_directions.txt --mask cat/data/mask.png -o cat-session",
      "refield estimate cat-session -o cat.rfield",
      "refield relight cat.rfield --env sunset.exr --rotate --frames 120 -o cat.mp4"], None),
]


# ---- Markdown


def github_slug(text, separator):
    """The anchors of headings as the documents link to them (tests/lint/check_links.py)."""
    return re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", separator)


def for_python_markdown(text):
    """Lists need an empty line before them and four spaces of indentation, unlike on GitHub."""
    result, in_fence, in_list = [], False, False
    for line in text.split("\n"):
        if line.startswith("```"):
            in_fence = not in_fence
        is_item = not in_fence and re.match(r"([-*]|\d+\.) ", line)
        previous = result[-1] if result else ""
        if is_item and previous.strip() and not in_list:
            result.append("")
        if is_item:
            in_list = True
        elif not line.startswith(" "):
            in_list = False
        elif in_list and not in_fence:
            line = "    " + line.lstrip() if previous.strip() else line
        result.append(line)
    return "\n".join(result)


class Sources:
    """The folder that mkdocs reads."""

    def __init__(self, folder):
        self.folder = folder
        self.listings = {}  # page of a file outside docs/ -> that file

    def write(self, page, text):
        path = self.folder / page
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def page_of(self, target):
        """Where a file or folder of the repository is on the site."""
        name = target.relative_to(root).as_posix()
        fixed = {"README.md": "index.md", "docs/README.md": "index.md", "CONTRIBUTING.md": "contributing.md",
                 "CHANGELOG.md": "changelog.md", "include/refield": "reference/cpp/index.md"}
        if name in fixed:
            return fixed[name]
        if name.startswith("docs/") and target.suffix not in (".py", ".sh", ".toml"):
            return name.removeprefix("docs/")
        page = f"sources/{name}.md"
        self.listings[page] = target
        return page

    def add(self, document, page):
        """A document of the repository, its links turned to those of the site."""
        def turned(match):
            link, _, anchor = match[2].partition("#")
            if re.match(r"[a-z]+:", link) or not link:
                return match[0]
            target = self.page_of((document.parent / link).resolve())
            return match[1] + os.path.relpath(target, pathlib.PurePosixPath(page).parent) + (f"#{anchor}" if anchor else "") + match[3]

        text = document.read_text(encoding="utf-8")
        parts = re.split(r"(^```.*?^```|`[^`\n]*`(?!\]))", text, flags=re.M | re.S)
        parts[::2] = [re.sub(r"(\]\()([^)\s]+)(\))", turned, part) for part in parts[::2]]
        self.write(page, for_python_markdown("".join(parts)))

    def write_listings(self):
        for page, target in self.listings.items():
            if target.is_dir():
                lines = [f"- `{path.relative_to(target)}`" for path in sorted(target.rglob("*")) if path.is_file()]
            else:
                lines = ["```" + {".cpp": "cpp", ".h": "cpp", ".py": "python", ".toml": "toml"}.get(target.suffix, "text"),
                         target.read_text(encoding="utf-8").rstrip().replace("\n```", "\n ```"), "```"]
            self.write(page, "\n".join([f"# {target.name}", "", f"`{target.relative_to(root)}`", "", *lines, ""]))


# ---- gallery


def make_gallery(program, folder):
    """Runs the commands unless they, and the program, are those that made what is there."""
    made_here = [entry for entry in GALLERY if (entry[3] or "gallery/").startswith("gallery/") and "git clone" not in entry[2][0]]
    commands = [command for entry in made_here for command in entry[2]]
    stamp = "\n".join([*commands, str(program.stat().st_mtime_ns)])
    made = folder / "made"
    if made.exists() and made.read_text() == stamp:
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "datasets_synthetic").symlink_to(root / "datasets_synthetic")
    environment = {**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"}
    for command in commands:
        subprocess.run(command, shell=True, check=True, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    made.write_text(stamp)


def gallery_page():
    lines, in_grid = ["---", "hide: [navigation, toc]", "---", "", "# Gallery", "",
                      "Pictures, films and pages that `refield` made, with the commands.", ""], False
    for title, text, commands, shown in GALLERY:
        live = shown and shown.endswith(".html")
        code = ["```sh", *commands, "```", ""] if commands else []
        if in_grid and (live or not shown):
            lines, in_grid = [*lines, "</div>", ""], False
        if live or not shown:
            lines += [f"## {title}", "", text, ""]
            if live:
                lines += [f'<iframe class="live" src="{shown}" title="{title}" loading="lazy"></iframe>', ""]
            lines += code
            continue
        if not in_grid:
            lines, in_grid = [*lines, "## Pictures and films", "", '<div class="gallery" markdown>'], True
        name = pathlib.PurePosixPath(shown)
        wide = ' class="wide"' if name.name in ("film.webp", "crops.jpg", "environments.jpg") else ""
        lines += [f'<figure markdown="1"{wide}>', ""]
        if name.suffix == ".mp4":
            lines += [f'<video src="{shown}#t=1.7" aria-label="{title}" controls loop muted playsinline preload="metadata"></video>', ""]
        else:
            lines += [f"![{title}]({shown})", ""]
        lines += [f'<figcaption markdown="1">', "", f"**{title}.** {text}", "", *code, "</figcaption>", "", "</figure>"]
    return "\n".join(lines + [""])


# ---- C++


def text_of(element):
    """A description of doxygen as Markdown."""
    if element is None:
        return ""
    parts = [element.text or ""]
    for child in element:
        if child.tag in ("computeroutput",):
            parts.append(f"`{''.join(child.itertext())}`")
        elif child.tag in ("para", "itemizedlist"):
            parts.append(text_of(child) + "\n\n")
        elif child.tag == "listitem":
            parts.append("\n- " + text_of(child).strip())
        else:
            parts.append(text_of(child))
        parts.append(child.tail or "")
    return "".join(parts)


def described(element):
    texts = [text_of(element.find(tag)).strip() for tag in ("briefdescription", "detaileddescription")]
    return "\n\n".join(re.sub(r"([<>|*])", r"\\\1", text) if "`" not in text else text for text in texts if text)


def code_of(element):
    """Code of doxygen, without the spaces that it adds."""
    text = "" if element is None else "".join(element.itertext())
    return re.sub(r" ([&*])", r"\1", re.sub(r"< ", "<", re.sub(r" >", ">", text))).strip()


def declaration(member):
    kind, name, kept = member.get("kind"), member.findtext("name"), code_of(member.find("type"))
    if kind == "function":
        parameters = []
        for parameter in member.findall("param"):
            default = parameter.find("defval")
            words = " ".join(w for w in (code_of(parameter.find("type")), parameter.findtext("declname")) if w)
            parameters.append(words + ("" if default is None else f" = {code_of(default)}"))
        lead = " ".join(w for w in ("static" if member.get("static") == "yes" else "", kept) if w)
        const = " const" if member.get("const") == "yes" else ""
        line = f"{lead} {name}({', '.join(parameters)}){const}".strip()
        return line if len(line) <= 80 else f"{lead} {name}(\n    ".lstrip() + ",\n    ".join(parameters) + f"){const}"
    if kind == "enum":
        return f"enum class {name} {{ {', '.join(v.findtext('name') for v in member.findall('enumvalue'))} }}"
    if kind == "typedef":
        return f"using {name} = {kept}"
    initial = member.find("initializer")
    return f"{kept} {name}{'' if initial is None else ' ' + code_of(initial)}"


def cpp_pages(sources, work):
    """One page for each public header: its introduction, its declarations, and the example that tests compile and run."""
    headers = sorted((root / "include/refield").glob("*.h"))
    (work / "doxyfile").write_text("\n".join([
        f"INPUT = {' '.join(map(str, headers))}", f"OUTPUT_DIRECTORY = {work}", "GENERATE_HTML = NO", "GENERATE_LATEX = NO", "GENERATE_XML = YES",
        "XML_PROGRAMLISTING = NO", "QUIET = YES", "WARNINGS = NO", "JAVADOC_AUTOBRIEF = YES", "MARKDOWN_SUPPORT = YES",
        "AUTOLINK_SUPPORT = NO", "MACRO_EXPANSION = YES", "PREDEFINED = REFIELD_API=", "EXTRACT_ALL = NO", f"STRIP_FROM_PATH = {root}"]))
    subprocess.run(["doxygen", work / "doxyfile"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    compounds = {}
    for path in (work / "xml").glob("*.xml"):
        for compound in ElementTree.parse(path).getroot().findall("compounddef"):
            compounds[compound.get("id")] = compound
    by_file = {}  # header -> [(line, Markdown)]
    for compound in compounds.values():
        place = compound.find("location")
        kind = compound.get("kind")
        if kind in ("struct", "class") and compound.get("prot") == "public":
            name = re.sub(r"^(refield::)?(v\d+_\d+::)?", "", compound.findtext("compoundname"))
            text = described(compound)
            members = [m for s in compound.findall("sectiondef") if s.get("kind", "").startswith("public") for m in s.findall("memberdef")]
            if not text and not any(described(m) for m in members):
                continue
            lines = [f"## {kind} {name}", "", text, ""]
            for member in members:
                if member.get("kind") == "friend" or member.findtext("name").startswith("operator"):
                    continue
                lines += ["```cpp", declaration(member), "```", "", described(member), ""]
            by_file.setdefault(place.get("file"), []).append((int(place.get("line")), "\n".join(lines)))
        elif kind == "namespace":
            for member in (m for s in compound.findall("sectiondef") for m in s.findall("memberdef")):
                place = member.find("location")
                if not described(member) or member.get("kind") not in ("function", "enum", "typedef", "variable"):
                    continue
                lines = [f"## {member.findtext('name')}", "", "```cpp", declaration(member), "```", "", described(member), ""]
                by_file.setdefault(place.get("file"), []).append((int(place.get("line")), "\n".join(lines)))
    navigation = []
    index = ["# C++ library", "", "The public headers. [The library in memory](../../guide/library.md) shows their use and how CMake finds them.", ""]
    for header in headers:
        intro = re.search(r"((?:^///.*\n)+)", header.read_text(), flags=re.M)[1]
        intro = re.sub(r"^/// ?", "", intro, flags=re.M).strip()
        lines = [f"# refield/{header.name}", "", intro, ""]
        lines += [text for _, text in sorted(by_file.get(str(header.relative_to(root)), []), key=lambda e: e[0])]
        example = (root / f"tests/library/examples/{header.stem}.cpp").read_text()
        lines += ["## Example", "", "```cpp", example.partition("\n")[2].rstrip(), "```", ""]
        sources.write(f"reference/cpp/{header.stem}.md", "\n".join(lines))
        index += [f"[refield/{header.name}]({header.stem}.md)", f":   {intro.partition('.')[0]}.".replace("\n", " "), ""]
        navigation.append({f"refield/{header.name}": f"reference/cpp/{header.stem}.md"})
    sources.write("reference/cpp/index.md", "\n".join(index))
    return [{"Overview": "reference/cpp/index.md"}] + navigation


# ---- Python


def from_numpydoc(text):
    """A docstring of NumPy's convention as Markdown."""
    text = re.sub(r"::$", ":", text, flags=re.M)  # what introduces a block of code
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.M)
    lines = [parts[0].strip(), ""]
    for heading, content in zip(parts[1::2], parts[2::2]):
        lines += [f"**{heading}**", ""]
        if heading == "Examples":
            lines += ["```python", content.strip(), "```", ""]
        elif re.search(r"^\S.*\n {2,}\S", content, flags=re.M):
            for name, description in re.findall(r"^(\S.*)\n((?:(?: .*)?(?:\n|$))*)", content, flags=re.M):
                paragraphs = [" ".join(paragraph.split()) for paragraph in re.split(r"\n\s*\n", description)]
                description = "\n\n    ".join(paragraph for paragraph in paragraphs if paragraph)
                lines += [f"`{name.strip()}`", f":   {description or '–'}", ""]
        else:
            lines += [content.strip(), ""]
    return "\n".join(lines)


def python_declaration(name, value):
    """A call with its types; in lines of their own where it is long."""
    signature = inspect.signature(value)
    words = []
    for parameter in signature.parameters.values():
        if parameter.kind == parameter.KEYWORD_ONLY and "*" not in words:
            words.append("*")
        hint = "" if parameter.annotation is parameter.empty else f": {parameter.annotation}"
        default = "" if parameter.default is parameter.empty else (" = " if hint else "=") + repr(parameter.default)
        words.append(parameter.name + hint + default)
    end = ")" if signature.return_annotation is signature.empty else f") -> {signature.return_annotation}"
    line = f"{name}({', '.join(words)}{end}"
    return line if len(line) <= 80 else f"{name}(\n    " + ",\n    ".join(words) + end


def python_page(sources, folder):
    """The module's docstrings."""
    sys.path.insert(0, folder)
    module = importlib.import_module("refield")
    lines = ["# Python module", "", from_numpydoc(inspect.getdoc(module) or ""), ""]

    def add(name, value, level):
        lines.extend([f"{'#' * level} {name.removeprefix('refield.')}", ""])
        if not isinstance(value, property):
            try:
                lines.extend(["```python", python_declaration(name, value), "```", ""])
            except (TypeError, ValueError):
                pass  # written in C, without a signature
        lines.extend([from_numpydoc(inspect.getdoc(value) or ""), ""])
        if inspect.isclass(value):
            for member, item in vars(value).items():
                if not member.startswith("_") and (isinstance(item, (property, staticmethod, classmethod)) or callable(item)):
                    add(f"{name}.{member}", item if isinstance(item, property) else getattr(value, member), level + 1)

    def add_all(module, names):
        for name in names:
            value = getattr(module, name)
            if inspect.ismodule(value):
                lines.extend([f"## {value.__name__}", "", from_numpydoc(inspect.getdoc(value) or ""), ""])
                add_all(value, getattr(value, "__all__", [n for n in dir(value) if not n.startswith("_")]))
            elif callable(value):
                add(f"{module.__name__}.{name}", value, 2)

    add_all(module, getattr(module, "__all__", [n for n in dir(module) if not n.startswith("_")]))
    sources.write("reference/python.md", "\n".join(lines))


# ---- the site that was built


class Page(html.parser.HTMLParser):
    """What a page loads and links to, and the anchors that it has."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.loaded, self.headings, self.without_text = set(), [], [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        elif tag == "link" and values.get("rel") not in ("canonical", "next", "prev"):
            self.loaded.append(values.get("href", ""))
        elif values.get("src"):
            self.loaded.append(values["src"])
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag == "img" and "alt" not in values:
            self.without_text += 1


def complaints_about(site):
    """Links to nothing, requests to other machines, images without a text, headings that leave out a level."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    for path, page in pages.items():
        name = path.relative_to(site)
        if name.name == "404.html":  # served under any address, so its links begin with /
            continue
        for link in page.links + page.loaded:
            scheme = urllib.parse.urlsplit(link)
            if scheme.scheme in ("http", "https", "mailto"):
                if link in page.loaded:
                    yield f"{name}: loads {link}"
                continue
            if scheme.scheme in ("data", "blob", "javascript"):
                continue
            target = path if not scheme.path else (path.parent / urllib.parse.unquote(scheme.path))
            target = pathlib.Path(os.path.normpath(target))
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                yield f"{name}: {link} does not exist"
            elif scheme.fragment and target in pages and urllib.parse.unquote(scheme.fragment) not in pages[target].ids:
                yield f"{name}: {link} names no place of that page"
        if page.without_text:
            yield f"{name}: {page.without_text} images without a text (alt)"
        if name.parts[0] != "gallery":
            for before, after in zip(page.headings, page.headings[1:]):
                if after > before + 1:
                    yield f"{name}: a heading of level {after} follows one of level {before}"
            if page.headings.count(1) != 1:
                yield f"{name}: {page.headings.count(1)} headings of level 1"
    for path in site.rglob("*.css"):
        for url in re.findall(r"url\(\s*['\"]?(https?:[^)'\"]+)|@import\s+['\"](https?:[^'\"]+)", path.read_text(encoding="utf-8")):
            yield f"{path.relative_to(site)}: loads {url[0] or url[1]}"


def pages_without_entry(navigation):
    listed = yaml.safe_dump(navigation)
    for document in sorted((root / "docs").glob("*/*.md")):
        name = document.relative_to(root / "docs").as_posix()
        if name not in listed:
            yield f"docs/site/mkdocs.yml: the navigation lacks {name}"


def main():
    if len(sys.argv) not in (4, 5):
        sys.exit(__doc__.split("\n\n")[1])
    program, gallery, site = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
    python = sys.argv[4] if len(sys.argv) == 5 else None
    work = site.with_name(site.name + "-work")
    shutil.rmtree(work, ignore_errors=True)
    sources = Sources(work / "docs")
    for document in sorted((root / "docs").rglob("*")):
        name = document.relative_to(root / "docs").as_posix()
        if document.suffix == ".md" and name != "README.md":
            sources.add(document, name)
        elif document.suffix in (".png", ".jpg", ".webp", ".svg", ".mp4"):
            (sources.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(document, sources.folder / name)
    for name, page in (("README.md", "index.md"), ("CONTRIBUTING.md", "contributing.md"), ("CHANGELOG.md", "changelog.md")):
        sources.add(root / name, page)
    make_gallery(program, gallery)
    sources.write("gallery.md", gallery_page())
    shutil.copy(root / "cmake/package/refield.svg", sources.folder / "images")
    for name in ("site.css", "site.js"):
        shutil.copy(root / "docs/site" / name, sources.folder)
    shutil.copytree(gallery, sources.folder / "gallery", ignore=shutil.ignore_patterns("*.rfield*", "*.json", "truth", "made", "datasets_synthetic"))

    settings = yaml.safe_load((root / "docs/site/mkdocs.yml").read_text())
    reference = next(entry["Reference"] for entry in settings["nav"] if "Reference" in entry)
    commands = sources.folder / "reference/commands"
    subprocess.run([sys.executable, root / "cli/manual.py", program, commands, "--markdown"], check=True)
    (commands / "index.md").rename(commands / "refield.md")
    # In the order of the help: parents before their children.
    pages = sorted(path.stem for path in commands.glob("*.md") if path.stem != "refield")
    listed = reference[1]["Commands"]
    listed += [{"refield": "reference/commands/refield.md"}]
    listed += [{f"refield {name.replace('-', ' ') if name != 'export-web' else name}": f"reference/commands/{name}.md"} for name in pages]
    if python:
        python_page(sources, python)
        reference.append({"Python": [{"Python module": "reference/python.md"}]})
    reference.append({"C++": cpp_pages(sources, work)})
    sources.write_listings()
    settings.update(docs_dir=str(sources.folder), site_dir=str(site))
    settings["nav"].append({"Project": [{"Changes": "changelog.md"}, {"Contributing": "contributing.md"}]})
    build(settings, work)
    complaints = sorted(set(complaints_about(site)) | set(pages_without_entry(settings["nav"])))
    print("\n".join(complaints))
    sys.exit(1 if complaints else 0)


def build(settings, work):
    (work / "mkdocs.yml").write_text(yaml.safe_dump(settings, sort_keys=False))
    configuration = mkdocs.config.load_config(config_file=str(work / "mkdocs.yml"))
    configuration["mdx_configs"]["toc"]["slugify"] = github_slug  # YAML cannot hold a function
    mkdocs.commands.build.build(configuration)
    # What the theme leaves out for users of keyboards and screen readers.
    for page in pathlib.Path(settings["site_dir"]).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        if 'class="md-search"' in text:
            text = text.replace('role="dialog"', 'role="dialog" aria-label="Search"')
            text = text.replace('class="md-search__scrollwrap"', 'class="md-search__scrollwrap" tabindex="0"')
            text = re.sub(r"<th( [^>]*)?></th>", r"<td\1></td>", text)  # an empty corner is no heading
            page.write_text(text.replace("<pre><", '<pre tabindex="0"><'), encoding="utf-8")


if __name__ == "__main__":
    main()
