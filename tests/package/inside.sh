#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What install.sh runs in the new Debian.
set -euo pipefail
cd /root
step() { printf 'package: %s\n' "$*"; }
fail() {
  printf 'package: FAILED: %s\n' "$*" >&2
  exit 1
}
apt() { DEBIAN_FRONTEND=noninteractive apt-get -y -qq -o Dpkg::Use-Pty=0 "$@" >/root/apt.log 2>&1 || { tail -n 30 /root/apt.log; fail "apt-get $*"; }; }
# Not what the system writes by itself: caches, databases of other packages, logs.
files() {
  find / -xdev \( -path /proc -o -path /dev -o -path /root -o -path /tmp -o -path /var/cache -o -path /var/lib/apt -o \
    -path /var/lib/dpkg -o -path /var/log -o -path /usr/share/mime -o -path /var/lib/systemd \) -prune -o -print | sort
}

echo "deb http://deb.debian.org/debian bookworm main" >/etc/apt/sources.list
# A minimal Debian may drop documentation; the man pages are wanted here.
rm -f /etc/dpkg/dpkg.cfg.d/*nodoc* /etc/dpkg/dpkg.cfg.d/docker*
apt update
# Whatever the packages need and what tries them out; so that only their own files differ afterwards.
apt install --no-install-recommends man-db bash-completion zsh shared-mime-info libglib2.0-bin desktop-file-utils g++ cmake make python3 file
depends=$(for package in /packages/*.deb; do dpkg-deb -f "$package" Depends; done | tr ',' '\n' | sed -E 's/\(.*//; s/\|.*//; s/ //g' | sort -u |
  grep -v -x -E 'refield|librefield.*|python3-refield')
# shellcheck disable=SC2086  # a list
apt install --no-install-recommends $depends
files >before

step "apt install"
apt install --no-install-recommends /packages/*.deb
[[ $(refield --version) == "refield $(dpkg-query -W -f '${Version}' refield | sed 's/-[^-]*$//')" ]] || fail "refield --version: $(refield --version)"

step "man pages"
man refield-estimate | col -b 2>/dev/null | grep -- '--hold-out N' >/dev/null || fail "man refield-estimate lacks --hold-out"
man refield-acquire-run >/dev/null || fail "man refield-acquire-run"

step "completion"
# shellcheck disable=SC1091
completed=$(. /usr/share/bash-completion/completions/refield; COMP_WORDS=(refield est) COMP_CWORD=1; _refield; echo "${COMPREPLY[@]}")
[[ $completed == estimate ]] || fail "bash completes 'est' to '$completed'"
zsh -fc 'fpath=(/usr/share/zsh/vendor-completions $fpath); autoload -Uz compinit; compinit -u -D; [[ $_comps[refield] == _refield ]]' ||
  fail "zsh does not know the completion"

step "a field, relit"
scenes=/usr/share/doc/refield/datasets_synthetic
refield --quiet simulate $scenes/tabletop/recipe.toml -o truth --size 64x48 --light-size 16x12 --train 2 --test 0,0,0 --quality 1
refield --quiet relight truth/transport.rfield --bar 0.5 --frames 2 -o bar
[[ -s bar/bar_0001.exr ]] || fail "no picture of the field"

step "type of .rfield files"
desktop-file-validate /usr/share/applications/refield-view.desktop
gio info -a standard::content-type truth/transport.rfield | grep application/x-rfield >/dev/null || fail "the type of .rfield is unknown"

step "find_package(refield)"
mkdir consumer
cat >consumer/CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES CXX)
find_package(refield 0.2 REQUIRED)
add_executable(consumer main.cpp)
target_link_libraries(consumer PRIVATE refield::refield)
END
cat >consumer/main.cpp <<'END'
#include "refield/relight.h"
#include <cstdio>
int main(int, char** argv) {
  const refield::Field field(argv[1]);
  const refield::LightDomain domain = field.light_domain();
  const refield::LightMap white{refield::Image(domain.width, domain.height, 3, 1.0f), domain.parameterisation};
  const refield::Image image = refield::Relighter(field).relight(white);
  std::printf("%d x %d, %s\n", image.width, image.height, image.at(32, 24, 1) > 0 ? "lit" : "dark");
}
END
cmake -S consumer -B consumer/build >consumer.log 2>&1 && cmake --build consumer/build >>consumer.log 2>&1 || { tail -n 30 consumer.log; fail "the consumer"; }
[[ $(consumer/build/consumer truth/transport.rfield) == "64 x 48, lit" ]] || fail "the consumer's output"

if dpkg-query -W python3-refield >/dev/null 2>&1; then
  step "import refield"
  python3 -c 'import refield; print(refield.__file__)' || fail "import refield"
fi

step "apt purge"
apt purge refield librefield-dev $(dpkg-query -W -f '${Package}\n' python3-refield 'librefield0*' 2>/dev/null || true)
files >after
left=$(comm -13 before after)
[[ -z $left ]] || fail "left behind: $left"
missing=$(comm -23 before after)
[[ -z $missing ]] || fail "removed files of others: $missing"
! gio info -a standard::content-type truth/transport.rfield | grep application/x-rfield >/dev/null || fail "the type of .rfield is still known"
step "installed, used and removed"
