#!/bin/sh
# SPDX-License-Identifier: MIT
# effect_list.sh FOLDER: the list of the library, one ENTRY(Type) for every line IMUCAL_EFFECT(Type) in the folder's files.
cat "$1"/*.cpp | sed -n 's/^IMUCAL_EFFECT(\([A-Za-z0-9]*\)).*$/ENTRY(\1)/p' | LC_ALL=C sort
