# SPDX-License-Identifier: MIT
"""JSON schemas of the shelves' manifests, written after the sources named, and stricter: a member that is not listed is a fault.

arduino     github.com/arduino/arduino-lint, etc/schemas/arduino-library-properties-*-schema.json (the "strict" rules)
platformio  PyPI platformio 6.2, platformio/package/manifest/schema.py (ManifestSchema); docs.platformio.org, library.json
zephyr      github.com/zephyrproject-rtos/zephyr, scripts/zephyr_module.py (METADATA_SCHEMA)
esp-idf     PyPI idf-component-manager 3.1, idf_component_tools/manifest/models.py (Manifest); what the registry asks for besides
"""

SEMVER = r"^(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)(-[0-9A-Za-z.-]+)?(\+[0-9A-Za-z.-]+)?$"
LINK = r"^https?://[^\s/]+\.[^\s/]+(/\S*)?$"


def text(lo=1, hi=1000, pattern=None):
    """A string of lo to hi characters."""
    return {"type": "string", "minLength": lo, "maxLength": hi, **({"pattern": pattern} if pattern else {})}


def listed(item):
    """A list of at least one."""
    return {"type": "array", "items": item, "minItems": 1}


def closed(required, properties):
    """An object with these members and no others."""
    return {"type": "object", "required": required, "properties": properties, "additionalProperties": False}


NOT_ARDUINO = {"not": {"pattern": "[aA][rR][dD][uU][iI][nN][oO]"}}
ARDUINO = closed(
    ["name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"],
    {"name": {**text(1, 16, r"^[a-zA-Z][a-zA-Z0-9_.\-]*$"), "not": {"pattern": "[lL][iI][bB][rR][aA][rR][yY]|[aA][rR][dD][uU][iI][nN][oO]"}},
     "version": text(pattern=SEMVER), "author": text(), "maintainer": {**text(), **NOT_ARDUINO}, "sentence": text(), "paragraph": text(0),
     "category": {"enum": ["Display", "Communication", "Signal Input/Output", "Sensors", "Device Control", "Timing", "Data Storage", "Data Processing",
                           "Other"]},
     "url": text(pattern=LINK), "architectures": text(), "includes": text(pattern=r"^\S+\.h(,\S+\.h)*$"), "depends": text(0),
     "dot_a_linkage": {"enum": ["true", "false"]}, "precompiled": {"enum": ["true", "full", "false"]}})

STAR = {"const": "*"}
PLATFORMIO = closed(
    ["name", "version", "description", "keywords", "repository", "license"],
    {"name": text(1, 100, r"^[^:;/,@<>]+$"), "version": text(1, 50, SEMVER), "description": text(), "keywords": text(pattern=r"^[a-z\d\- ]{1,50}(, ?[a-z\d\- ]{1,50})*$"),
     "license": text(1, 255, r"^[A-Za-z0-9.+-]+$"), "homepage": text(1, 255, LINK),
     "repository": closed(["type", "url"], {"type": {"enum": ["git", "hg", "svn"]}, "url": text(1, 255, LINK), "branch": text(1, 50)}),
     "frameworks": {"anyOf": [STAR, listed(text(1, 50, r"^[a-z\d\-_]+$"))]}, "platforms": {"anyOf": [STAR, listed(text(1, 50, r"^[a-z\d\-_]+$"))]},
     "headers": listed(text(1, 255)), "build": closed([], {"flags": listed(text(pattern="^-")), "srcDir": text(), "includeDir": text(), "srcFilter": listed(text())}),
     "examples": listed(closed(["base", "files"], {"name": text(1, 100, r"^[a-zA-Z\d\-_/. ]+$"), "base": text(), "files": listed(text())}))})

NAMES = {"type": "array", "items": {"type": "string"}}
ZEPHYR = closed(
    ["name", "build"],
    {"name": text(), "tests": NAMES, "samples": NAMES, "boards": NAMES,
     "build": closed(["cmake", "kconfig"], {
         "cmake": text(), "kconfig": text(), **{k: {"type": "boolean"} for k in ("cmake-ext", "kconfig-ext", "sysbuild-cmake-ext", "sysbuild-kconfig-ext")},
         "sysbuild-cmake": text(), "sysbuild-kconfig": text(), "depends": NAMES,
         "settings": closed([], {f"{k}_root": text() for k in ("board", "dts", "soc", "arch", "module_ext", "sca")})})})

ESP_IDF = closed(
    ["version", "description", "url", "license", "dependencies"],
    {"version": text(pattern=SEMVER), "description": text(), "license": text(pattern=r"^[A-Za-z0-9.+-]+$"),
     **{k: text(pattern=LINK) for k in ("url", "repository", "documentation", "issues", "discussion", "changelog")},
     "targets": listed(text()), "tags": listed(text(3, 32, r"^[A-Za-z0-9_\-]+$")), "maintainers": listed(text()), "examples": {"type": "array"},
     "files": {"type": "object"}, "sbom": {"type": "object"},
     "dependencies": {"type": "object", "required": ["idf"], "additionalProperties": {"anyOf": [text(pattern=r"^(\*|[<>=~^!]*\s*\d[\w.*-]*(\s*,\s*[<>=~^!]+\s*\d[\w.*-]*)*)$"), {"type": "object"}]}}})

SCHEMAS = {"arduino": ("library.properties", ARDUINO), "platformio": ("library.json", PLATFORMIO), "zephyr": ("zephyr/module.yml", ZEPHYR),
           "esp-idf": ("idf_component.yml", ESP_IDF)}
