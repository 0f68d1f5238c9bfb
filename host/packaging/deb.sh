#!/bin/sh
# SPDX-License-Identifier: MIT
# A Debian package from build/deb/root: the libraries the programs ask for become its dependencies.
set -eu
root=$BUILD/deb/root
architecture=$(dpkg --print-architecture)
libraries=$(for file in "$root"/usr/bin/* "$root"/usr/libexec/imucal/* "$root"/usr/lib/imucal/python/imucal/_core.so; do
  ldd "$file" | awk '/=> \// {print $3}'
done | sort -u | while read -r library; do
  owner=$(dpkg -S "$(readlink -f "$library")" 2>/dev/null | head -1 | cut -d: -f1)
  [ -n "$owner" ] || owner=$(dpkg -S "$(readlink -f "$library" | sed 's|^/usr||')" 2>/dev/null | head -1 | cut -d: -f1)
  echo "$owner"
done | sort -u | grep . | sed ':a;N;$!ba;s/\n/, /g')
strip --strip-unneeded "$root"/usr/bin/* "$root"/usr/libexec/imucal/* "$root/usr/lib/imucal/python/imucal/_core.so"
mkdir -p "$root/DEBIAN" "$root/usr/share/doc/imucal"
gzip -9nf "$root"/usr/share/man/man1/*.1
sed -i 's|^\(share/man/man1/.*\.1\)$|\1.gz|' "$root/usr/lib/imucal/manifest"
cp common/LICENSE "$root/usr/share/doc/imucal/copyright"
cat > "$root/DEBIAN/control" <<CONTROL
Package: imucal
Version: $VERSION
Architecture: $architecture
Maintainer: imucal developers <imucal@example.org>
Section: science
Priority: optional
Depends: $libraries, python3, python3-numpy
Recommends: python3-matplotlib, python3-scipy, python3-h5py, python3-jsonschema
Installed-Size: $(du -sk "$root/usr" | cut -f1)
Description: static thermal calibration of inertial sensors
 One command, imucal, for the thermal calibration of gyros and accelerometers:
 import of recorded logs, error models, temperature profiles, calibration,
 diagnosis, export to autopilots; and the C99 core as a library.
CONTROL
# What Python compiled there while imucal ran.
cat > "$root/DEBIAN/prerm" <<'PRERM'
#!/bin/sh
set -e
[ ! -d /usr/lib/imucal ] || find /usr/lib/imucal -name __pycache__ -prune -exec rm -rf {} +
PRERM
chmod 755 "$root/DEBIAN/prerm"
dpkg-deb --root-owner-group -Zgzip --build "$root" "$BUILD/imucal_${VERSION}_$architecture.deb" > /dev/null
echo "imucal: $BUILD/imucal_${VERSION}_$architecture.deb ($(du -k "$BUILD/imucal_${VERSION}_$architecture.deb" | cut -f1) kB)"
