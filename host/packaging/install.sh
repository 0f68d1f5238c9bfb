#!/bin/sh
# SPDX-License-Identifier: MIT
# Puts what was built under $DESTDIR$PREFIX and notes every file in lib/imucal/manifest, for make uninstall.
set -eu
root=$DESTDIR$PREFIX
list=$(mktemp)
trap 'rm -f "$list"' EXIT

# put MODE SOURCE PLACE: one file, noted.
put() {
  install -D -m "$1" "$2" "$root/$3"
  echo "$3" >> "$list"
}

put 755 "$BUILD/bin/imucal" bin/imucal
for program in "$BUILD"/bin/*; do
  name=$(basename "$program")
  [ "$name" = imucal ] || put 755 "$program" "libexec/imucal/$name"
done

put 644 "$BUILD/lib/libimucal_core.a" lib/libimucal.a
for header in common/*.h; do put 644 "$header" "include/imucal/$(basename "$header")"; done
sed -e "s|@PREFIX@|$PREFIX|" -e "s|@VERSION@|$VERSION|" host/packaging/imucal.pc.in > "$list.file"
put 644 "$list.file" lib/pkgconfig/imucal.pc
put 644 host/packaging/imucal-config.cmake lib/cmake/imucal/imucal-config.cmake
sed -e "s|@VERSION@|$VERSION|" host/packaging/imucal-config-version.cmake.in > "$list.file"
put 644 "$list.file" lib/cmake/imucal/imucal-config-version.cmake
rm -f "$list.file"

(cd host/python && find imucal -name '*.py' -o -name '*.json' -path '*/schema/*' -o -name py.typed -o -name '*.pyi') | while read -r file; do
  put 644 "host/python/$file" "lib/imucal/python/$file"
done
put 644 common/version.h lib/imucal/python/imucal/version.h
put 755 "$BUILD/python/_core.so" lib/imucal/python/imucal/_core.so
for file in diagnosis_report.py templates/diagnosis.html.j2 templates/diagnosis.css; do
  put 644 "host/scripts/$file" "lib/imucal/python/scripts/$file"
done

for page in "$BUILD"/shell/man1/*.1; do put 644 "$page" "share/man/man1/$(basename "$page")"; done
put 644 "$BUILD/shell/bash/imucal" share/bash-completion/completions/imucal
put 644 "$BUILD/shell/zsh/_imucal" share/zsh/site-functions/_imucal

install -D -m 644 "$list" "$root/lib/imucal/manifest"
echo "imucal: $(wc -l < "$list") files under $root"
