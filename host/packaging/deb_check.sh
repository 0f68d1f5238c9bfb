#!/bin/sh
# SPDX-License-Identifier: MIT
# Installs the Debian package in a root made from nothing and runs it there.  Needs root and mmdebstrap.
set -eu
command -v mmdebstrap > /dev/null || { echo "imucal: mmdebstrap is missing: apt-get install mmdebstrap" >&2; exit 1; }
package=$BUILD/imucal_${VERSION}_$(dpkg --print-architecture).deb
root=$(mktemp -d)
trap 'umount "$root/proc" 2>/dev/null || :; rm -rf "$root"' EXIT
chmod 755 "$root"
mmdebstrap --quiet --mode=root --variant=apt --aptopt='APT::Install-Recommends "false"' "$(. /etc/os-release; echo "$VERSION_CODENAME")" "$root"
cp "$package" "$root/imucal.deb"
[ ! -e /etc/resolv.conf ] || cp /etc/resolv.conf "$root/etc/resolv.conf"
mount -t proc proc "$root/proc"
chroot "$root" sh -ec '
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -qq
  apt-get install -y -qq --no-install-recommends ./imucal.deb > /dev/null
  cd /tmp
  imucal --version
  imucal dp --version
  imucal example play -q
  imucal import play/run1.csv -o again.csv
  imucal calibrate fit play/run1.csv --method kf --order 3 --model play/model.json --accept slow --accept residual -o table.json -q
  imucal export table.json --to c-header -o table.h
  apt-get remove -y -qq imucal > /dev/null
  [ ! -e /usr/bin/imucal ]
  [ ! -e /usr/libexec/imucal ]'
echo "imucal: $package installed, ran and went in a clean root"
