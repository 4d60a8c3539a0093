#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: kernel.sh CACHE
# Fetches Debian's stock kernel and builds the virtual drivers that it lacks, into CACHE/VERSION; prints that folder.
# Needs the packages linux-headers-amd64, cpio, kmod, busybox-static, xz-utils and Debian's package server.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cache=$(mkdir -p "$1" && cd "$1" && pwd)

depends_on() { apt-cache depends "$1" | awk '$1 == "Depends:" {print $2; exit}'; }
image=$(depends_on linux-image-amd64)
[[ -n $image ]] || { echo "kernel.sh: apt does not know linux-image-amd64" >&2; exit 3; }
version=${image#linux-image-}
series=$(cut -d. -f1,2 <<<"$version")
folder=$cache/$version
recipe=$(cat "$here"/kernel.sh "$here"/initrd.sh "$here"/drivers/* | sha256sum | cut -c1-16)
if [[ $(cat "$folder/done" 2>/dev/null || true) == "$recipe" ]]; then
  echo "$folder"
  exit
fi
mkdir -p "$folder/debs"
cd "$folder"
rm -rf root source drivers done

fetch() {
  ls "debs/$1"_*.deb >/dev/null 2>&1 || (cd debs && apt-get -o APT::Sandbox::User=root download -qq "$1" >&2)
  dpkg -x "debs/$1"_*.deb root
}
fetch "$image"
fetch "linux-source-$series"

mkdir source
tar -C source -xf "root/usr/src/linux-source-$series.tar.xz" --strip-components=1 --wildcards \
  '*/drivers/gpio/gpio-sim.c' '*/drivers/gpio/gpiolib.h' '*/kernel/irq/irq_sim.c' '*/drivers/gpu/drm/vkms' \
  '*/drivers/media/test-drivers/vivid'
rm "root/usr/src/linux-source-$series.tar.xz"
for change in "$here"/drivers/*.patch; do patch -s -d source -p1 <"$change" >&2; done

mkdir -p drivers/gpio
cp source/drivers/gpio/{gpio-sim.c,gpiolib.h} source/kernel/irq/irq_sim.c drivers/gpio
cp -r source/drivers/gpu/drm/vkms source/drivers/media/test-drivers/vivid drivers
echo 'obj-m := irq_sim.o gpio-sim.o' >drivers/gpio/Makefile
headers=/usr/src/linux-headers-$version
for driver in gpio vkms vivid; do
  make -s -C "$headers" M="$PWD/drivers/$driver" CONFIG_DRM_VKMS=m modules 2>&1 |
    { grep -v 'Skipping BTF' || true; } >&2
done
mkdir -p "root/lib/modules/$version/lab"
cp drivers/gpio/*.ko drivers/vkms/vkms.ko "root/lib/modules/$version/lab"
cp drivers/vivid/vivid.ko "root/lib/modules/$version/lab/vivid_lab.ko"
depmod -b root "$version"
"$here/initrd.sh" root "$version" initrd.gz
rm -rf source
echo "$recipe" >done
echo "$folder"
