#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: debian_source.sh LIBRARY SOURCE FOLDER
# Fetches Debian's source package SOURCE in the version of the installed package LIBRARY, and unpacks it into FOLDER/source.
# Needs dpkg-dev and Debian's package server, which need not be set up for sources.
set -euo pipefail
library=$1 source=$2
mkdir -p "$3/lists/partial"
cd "$3"
read -r url suite < <(apt-cache policy "$library" | awk '$2 ~ /^https?:/ {print $2, $3; exit}')
echo "deb-src $url ${suite%/*} ${suite##*/}" >sources.list
apt=(apt-get -o Dir::Etc::SourceList="$PWD/sources.list" -o Dir::Etc::SourceParts=/dev/null -o Dir::State::Lists="$PWD/lists"
  -o Dir::Cache="$PWD" -o APT::Sandbox::User=)
"${apt[@]}" update
"${apt[@]}" source --download-only "$source"
rm -rf source
dpkg-source -x "${source}"_*.dsc source
