#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# install.sh FOLDER: installs the folder's packages with apt in a new Debian 12, uses them there, removes them, and
# compares the files of the system before and after. Needs root and the network. The Debian of the first run is kept
# in build/debian.
set -euo pipefail
packages=$(realpath "$1")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
if ((EUID != 0)); then
  echo "SKIPPED: installing the packages in a new Debian, which needs root"
  exit 0
fi
base=build/debian root=$PWD/build/package-root
if [[ ! -e $base/etc/debian_version ]]; then
  echo "Fetching a minimal Debian 12"
  rm -rf --one-file-system "$base.part"
  debootstrap --variant=minbase bookworm "$base.part" http://deb.debian.org/debian >build/debootstrap.log ||
    { tail -n 20 build/debootstrap.log; exit 1; }
  mv "$base.part" "$base"
fi
grep -q " $root" /proc/mounts && { echo "$root contains mounts"; exit 1; }
rm -rf --one-file-system "$root"
cp -a "$base" "$root"
mkdir "$root/packages"
cp "$packages"/*.deb tests/package/inside.sh "$root/packages"
cp /etc/resolv.conf "$root/etc"
cp -a /etc/apt/apt.conf.d/. "$root/etc/apt/apt.conf.d"  # a proxy, for instance
# Mounts in a name space of their own end with it, so that nothing of this system is in the root that is removed.
status=0
unshare --mount --propagation private bash -c '
  set -e
  mount -t proc proc "$0/proc"
  mount --rbind /dev "$0/dev"
  env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 TERM=dumb chroot "$0" /packages/inside.sh
' "$root" || status=1
rm -rf --one-file-system "$root"
exit $status
