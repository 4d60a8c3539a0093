#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: virtual_dslr.sh FOLDER
# Builds the virtual PTP camera of libgphoto2 from Debian's source, as a port driver for the installed library, and prints
# the driver's folder: what IOLIBS is to name. Kept in FOLDER. The camera asks the program that it runs in for its
# photographs, and whether something fails (tests/devices/virtual_dslr.h).
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$1"
folder=$(realpath "$1")
version=$(pkg-config --modversion libgphoto2)
stamp=$version-$(cat "$here/virtual_dslr.sh" "$here/virtual_dslr.h" | cksum | cut -d ' ' -f 1)
if [[ -e $folder/driver/vusb.so && $(cat "$folder/stamp" 2>/dev/null) == "$stamp" ]]; then
  echo "$folder/driver"
  exit
fi
exec 3>&1 >"$folder/log" 2>&1
rm -rf "$folder/driver"
mkdir -p "$folder/driver"
"$here/../support/debian_source.sh" libgphoto2-dev libgphoto2 "$folder"
cd "$folder"
vusb=source/libgphoto2_port/vusb
cp "$here/virtual_dslr.h" "$vusb/"
# Every place is found by its text; one that is not there ends the script.
python3 - "$vusb/vcamera.c" <<'PYTHON'
import re, sys

path = sys.argv[1]
code = open(path, encoding="utf-8").read()


def function(name):
    """From a function's name to its closing brace."""
    start = re.search(rf"^{name} ?\([^;]*?\) ?\{{", code, re.M).start()
    return start, code.index("\n}", start)


def change(name, *pairs):
    global code
    start, end = function(name)
    body = code[start:end]
    for old, new in pairs:
        if old not in body:
            sys.exit(f"{path}: {name} has no '{old}'")
        body = body.replace(old, new)
    code = code[:start] + body + code[end:]


ask = "{{ unsigned fault = virtual_dslr_ask({}); if (fault) {{ ptp_response (cam, fault, 0); return 1; }} }}"
change(
    "ptp_initiatecapture_write",
    ("capcnt > 150", "0"),
    # The photograph is a RAW file, made anew in the place of the one that lies in the camera's tree.
    ('".jpg"', '".dng"'), ('".JPG"', '".DNG"'), ("%04d.JPG", "%04d.DNG"),
    ("if (capcnt++ == 150) {",
     # The store runs full during the photograph: libgphoto2 2.5.30 waits for ever if the request itself is refused.
     'capcnt++;\nif (virtual_dslr_ask ("photograph", cur->fsname, cam->shutterspeed, cam->fnumber)) {'),
    ("newcur->stbuf\t= cur->stbuf;", "stat (cur->fsname, &newcur->stbuf);"),
    ("cam, 100, 0x4002", "cam, 5, 0x4002"), ("cam, 120, 0x400d", "cam, 6, 0x400d"), ("cam, 80, 0x4002", "cam, 4, 0x4002"))
change("ptp_getobject_write",
       ("CHECK_PARAM_COUNT(1);", "CHECK_PARAM_COUNT(1);\n" + ask.format('"download", "", 0, 0')))
change("static int vcam_write",
       ("if (!cam->outbulk)",
        'if (virtual_dslr_ask("cable", "", 0, 0)) return GP_ERROR_IO_USB_FIND;\n\tif (!cam->outbulk)'))
change("vcam_readint",
       ("if (!first_interrupt)",
        'if (virtual_dslr_ask("cable", "", 0, 0)) return GP_ERROR_IO_USB_FIND;\n\tif (!first_interrupt)'))
start = code.index("static int ptp_inject_interrupt(")
code = code[:start] + '#include "virtual_dslr.h"\n' + code[start:]
code = code.replace("read_tree(VCAMERADIR)", 'read_tree(getenv("VIRTUAL_DSLR_TREE"))')
open(path, "w", encoding="utf-8").write(code)
PYTHON
cat >source/config.h <<'C'
#define HAVE_LIMITS_H 1
#define HAVE_SYS_PARAM_H 1
#define GETTEXT_PACKAGE_LIBGPHOTO2_PORT "libgphoto2_port-12"
#define GETTEXT_PACKAGE_LIBGPHOTO2 "libgphoto2-6"
C
flags=(-std=gnu11 -O1 -w -fPIC -D_GNU_SOURCE -D_GPHOTO2_INTERNAL_CODE -Isource -Isource/libgphoto2_port -Isource/camlibs/ptp2 -I"$vusb")
# The driver finds its camera, by the numbers of a Nikon D750, only where it is built for fuzzing.
grep -q '^#ifdef FUZZ_PTP' "$vusb/vusb.c"
sed -i 's/^#ifdef FUZZ_PTP/#if 1/' "$vusb/vusb.c"
cc "${flags[@]}" -c "$vusb/vusb.c" -o driver/vusb.o
cc "${flags[@]}" -c "$vusb/vcamera.c" -o driver/vcamera.o
cc -shared driver/vusb.o driver/vcamera.o -o driver/vusb.so -lgphoto2_port -ldl
rm driver/*.o
echo "$stamp" >stamp
echo "$folder/driver" >&3
