# SPDX-License-Identifier: MIT
"""Archives of the C core for those who take libraries from a shelf: Arduino, PlatformIO, Zephyr, ESP-IDF, plain CMake.

    dist.py --version X.Y.Z -o FOLDER [--check]

Each archive holds the sources, the manifest of its shelf, the licence and an example.  --check unpacks each, validates the
manifest against the rules its documentation states, and compiles the example against the unpacked sources with
arm-none-eabi-gcc and, where there is a CMakeLists.txt of ours, with CMake.
"""
import argparse
import json
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

from manifest_schemas import SCHEMAS

ROOT = Path(__file__).resolve().parents[2]
TEXT = "Static thermal calibration of gyros and accelerometers: learns bias over temperature while it changes, compensates in integers."
URL = "https://example.org/imucal"

EXAMPLE = """/* SPDX-License-Identifier: MIT
 * Learn the thermal polynomial of one gyro from 1-s means; the numbers stand for what your sensor says. */
#include "kf.h"

/* 0.6 deg/sqrt(h), 20 dph with 100 s; the host computes m, q, r: no libm on the MCU. */
static const imucal_kf_config_t config = {3, 30.0f, 30.0f, 0.00995016625f, 7.92053068f, 1296.0f, 400.0f, 1e4f};

float imucal_example(const float* mean_dph, const float* temp_degc, unsigned n, float at_degc) {
  imucal_kf_t kf;
  if (imucal_kf_init(&kf, &config) != IMUCAL_OK) return 0.0f;
  for (unsigned i = 0; i < n; i++)
    if (imucal_kf_update(&kf, mean_dph[i], temp_degc[i]) != IMUCAL_OK) return 0.0f;
  return imucal_kf_bias(&kf, at_degc);
}
"""
MAIN = EXAMPLE + """
int main(void) {
  static const float rate[4] = {10.0f, 11.0f, 12.0f, 13.0f}, temp[4] = {20.0f, 25.0f, 30.0f, 35.0f};
  return imucal_example(rate, temp, 4, 25.0f) > 0.0f ? 0 : 1;
}
"""
SKETCH = """// SPDX-License-Identifier: MIT
#include <imucal.h>

static imucal_kf_t filter;

void setup() {
  const imucal_kf_config_t config = {3, 30.0f, 30.0f, 0.00995016625f, 7.92053068f, 1296.0f, 400.0f, 1e4f};
  Serial.begin(115200);
  if (imucal_kf_init(&filter, &config) != IMUCAL_OK) Serial.println("imucal: refused");
}

void loop() {
  // Once a second: the mean rate of the second and the sensor's temperature.
  const float mean_dph = 412.0f, temp_degc = 24.8f;
  if (imucal_kf_update(&filter, mean_dph, temp_degc) == IMUCAL_OK) Serial.println(imucal_kf_bias_sigma(&filter, 25.0f));
  delay(1000);
}
"""
CMAKE = """cmake_minimum_required(VERSION 3.13)
project(imucal VERSION {version} LANGUAGES C)
file(GLOB IMUCAL_SOURCES ${{CMAKE_CURRENT_SOURCE_DIR}}/src/*.c)
add_library(imucal STATIC ${{IMUCAL_SOURCES}})
add_library(imucal::imucal ALIAS imucal)
target_include_directories(imucal PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}}/src)
target_compile_options(imucal PRIVATE -std=c99 -ffp-contract=off)
if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  add_executable(imucal_example examples/learn/main.c)
  target_link_libraries(imucal_example PRIVATE imucal)
endif()
"""


def rooms():
    """The headers of the core, in an order in which one may include them."""
    return sorted(p.name for p in (ROOT / "common").glob("*.h"))


def core(folder):
    """{place: text} of the sources."""
    return {f"{folder}/{p.name}": p.read_text() for p in sorted((ROOT / "common").iterdir()) if p.suffix in (".c", ".h")}


def common_files():
    """What every archive holds."""
    return {"LICENSE": (ROOT / "common/LICENSE").read_text(), "README.md": (ROOT / "common/README.md").read_text()}


def arduino(version):
    """library.properties (Arduino library specification 1.5)."""
    umbrella = "/* SPDX-License-Identifier: MIT */\n#pragma once\n" + "".join(f'#include "{h}"\n' for h in rooms())
    properties = (f"name=imucal\nversion={version}\nauthor=imucal developers\nmaintainer=imucal developers\nsentence={TEXT}\n"
                  f"paragraph=C99, no heap, no libm; the same bits on every MCU.\ncategory=Sensors\nurl={URL}\narchitectures=*\nincludes=imucal.h\n")
    return {**common_files(), **core("src"), "src/imucal.h": umbrella, "library.properties": properties, "examples/Learn/Learn.ino": SKETCH}


def platformio(version):
    """library.json (PlatformIO library manifest)."""
    manifest = {"name": "imucal", "version": version, "description": TEXT, "keywords": "imu, gyro, thermal, calibration, kalman", "license": "MIT",
                "repository": {"type": "git", "url": URL + ".git"}, "frameworks": "*", "platforms": "*", "headers": rooms(),
                "build": {"flags": ["-ffp-contract=off"], "srcDir": "src", "includeDir": "src"}, "examples": [{"name": "learn", "base": "examples/learn", "files": ["main.c"]}]}
    return {**common_files(), **core("src"), "library.json": json.dumps(manifest, indent=2) + "\n", "examples/learn/main.c": MAIN}


def zephyr(version):
    """zephyr/module.yml, CMakeLists.txt and Kconfig (Zephyr project documentation, "Modules")."""
    module = "name: imucal\nbuild:\n  cmake: zephyr\n  kconfig: zephyr/Kconfig\nsamples:\n  - examples\n"
    cmake = ("if(CONFIG_IMUCAL)\n  zephyr_library_named(imucal)\n  file(GLOB IMUCAL_SOURCES ${ZEPHYR_CURRENT_MODULE_DIR}/src/*.c)\n  zephyr_library_sources(${IMUCAL_SOURCES})\n"
             "  zephyr_library_compile_options(-ffp-contract=off)\n  zephyr_include_directories(${ZEPHYR_CURRENT_MODULE_DIR}/src)\nendif()\n")
    kconfig = "config IMUCAL\n\tbool \"imucal: static thermal calibration of inertial sensors\"\n"
    project = ("cmake_minimum_required(VERSION 3.20.0)\nfind_package(Zephyr REQUIRED HINTS $ENV{ZEPHYR_BASE})\nproject(imucal_learn)\n"
               "target_sources(app PRIVATE main.c)\n")
    return {**common_files(), **core("src"), "zephyr/module.yml": module, "zephyr/CMakeLists.txt": cmake, "zephyr/Kconfig": kconfig,
            "examples/learn/main.c": MAIN, "examples/learn/CMakeLists.txt": project, "examples/learn/prj.conf": "CONFIG_IMUCAL=y\nCONFIG_FPU=y\n"}


def esp_idf(version):
    """idf_component.yml and CMakeLists.txt (ESP-IDF component manager)."""
    manifest = f'version: "{version}"\ndescription: "{TEXT}"\nurl: "{URL}"\nlicense: "MIT"\ndependencies:\n  idf: ">=4.4"\n'
    cmake = 'file(GLOB IMUCAL_SOURCES src/*.c)\nidf_component_register(SRCS ${IMUCAL_SOURCES} INCLUDE_DIRS src)\ntarget_compile_options(${COMPONENT_LIB} PRIVATE -ffp-contract=off)\n'
    return {**common_files(), **core("src"), "idf_component.yml": manifest, "CMakeLists.txt": cmake,
            "examples/learn/main/main.c": MAIN.replace("int main(void) {", "void app_main(void) {").replace("return imucal_example(rate, temp, 4, 25.0f) > 0.0f ? 0 : 1;", "(void)imucal_example(rate, temp, 4, 25.0f);"),
            "examples/learn/main/CMakeLists.txt": "idf_component_register(SRCS main.c)\n",
            "examples/learn/CMakeLists.txt": "cmake_minimum_required(VERSION 3.16)\ninclude($ENV{IDF_PATH}/tools/cmake/project.cmake)\nproject(imucal_learn)\n"}


def plain_cmake(version):
    """A CMake project that may be added as a subdirectory."""
    return {**common_files(), **core("src"), "CMakeLists.txt": CMAKE.format(version=version), "examples/learn/main.c": MAIN}


SHELVES = {"arduino": arduino, "platformio": platformio, "zephyr": zephyr, "esp-idf": esp_idf, "cmake": plain_cmake}


def write_archive(folder, shelf, version, files):
    """Arduino takes zip, the others tar.gz; times are fixed, so that the same sources give the same bytes."""
    name = f"imucal-{shelf}-{version}"
    if shelf == "arduino":
        path = folder / f"{name}.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for place, text in sorted(files.items()):
                archive.writestr(zipfile.ZipInfo(f"imucal/{place}", (2020, 1, 1, 0, 0, 0)), text)
        return path
    import gzip
    import io
    path = folder / f"{name}.tar.gz"
    with open(path, "wb") as raw, gzip.GzipFile(fileobj=raw, mode="wb", mtime=0) as packed, tarfile.open(fileobj=packed, mode="w") as archive:
        for place, text in sorted(files.items()):
            info = tarfile.TarInfo(f"imucal/{place}")
            info.size = len(text.encode())
            archive.addfile(info, io.BytesIO(text.encode()))
    return path


def read_manifest(path):
    """A manifest as a dict: key=value lines, JSON or YAML."""
    if path.suffix == ".properties":
        return dict(line.split("=", 1) for line in path.read_text().splitlines() if line and not line.startswith("#"))
    if path.suffix == ".json":
        return json.loads(path.read_text())
    import yaml
    return yaml.safe_load(path.read_text())


def named_files(shelf, data):
    """Files that a manifest names, from the archive's top."""
    if shelf == "arduino":
        return [f"src/{name}" for name in data.get("includes", "").split(",")]
    if shelf == "platformio":
        examples = [f"{e['base']}/{f}" for e in data.get("examples", []) for f in e["files"]]
        return examples + [f"{data['build']['includeDir']}/{h}" for h in data["headers"]] + [data["build"]["srcDir"]]
    if shelf == "zephyr":
        return [f"{data['build']['cmake']}/CMakeLists.txt", data["build"]["kconfig"], *data.get("samples", [])]
    return ["CMakeLists.txt"]


def check_manifest(shelf, top):
    """What the shelf asks of its manifest (manifest_schemas.py names the sources); returns a list of faults."""
    if shelf not in SCHEMAS:
        return []
    import jsonschema
    place, schema = SCHEMAS[shelf]
    data = read_manifest(top / place)
    faults = [f"{place}: {'.'.join(map(str, e.absolute_path)) or 'top'}: {e.message}" for e in jsonschema.Draft202012Validator(schema).iter_errors(data)]
    return faults or [f"{place}: {name} is not there" for name in named_files(shelf, data) if not (top / name).exists()]


def compile_for_arm(top):
    """Every source and the example, with the strictest warnings, for a Cortex-M4F and a Cortex-M0."""
    examples = sorted([*top.glob("examples/**/*.c"), *top.glob("examples/**/*.ino")])
    for cpu in (["-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"], ["-mcpu=cortex-m0"]):
        flags = ["-mthumb", *cpu, "-Os", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", f"-I{top / 'src'}", "-c", "-o", str(top / "out.o")]
        for source in sorted(top.glob("src/*.c")) + [e for e in examples if e.suffix == ".c"]:
            subprocess.run(["arm-none-eabi-gcc", "-std=c99", *flags, str(source)], check=True)
        for sketch in [e for e in examples if e.suffix == ".ino"]:
            (top / "Arduino.h").write_text("struct Port { void begin(long); void println(const char*); void println(double); };\nextern Port Serial;\nvoid delay(unsigned long);\n")
            subprocess.run(["arm-none-eabi-g++", "-std=c++11", *flags, "-x", "c++", "-include", str(top / "Arduino.h"), str(sketch)], check=True)


def check_archive(shelf, path):
    """Unpack, validate, compile."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.unpack_archive(path, folder)
        top = Path(folder) / "imucal"
        faults = check_manifest(shelf, top)
        if faults:
            sys.exit(f"dist.py: {path.name}: " + "; ".join(faults))
        compile_for_arm(top)
        if shelf == "cmake":
            subprocess.run(["cmake", "-S", str(top), "-B", str(top / "b")], check=True, stdout=subprocess.DEVNULL)
            subprocess.run(["cmake", "--build", str(top / "b")], check=True, stdout=subprocess.DEVNULL)
            subprocess.run([str(top / "b/imucal_example")], check=True)


def main():
    """Write all archives; with --check, check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", required=True)
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--only", choices=SHELVES)
    given = parser.parse_args()
    out = Path(given.output)
    out.mkdir(parents=True, exist_ok=True)
    shelves = [given.only] if given.only else list(SHELVES)
    for shelf in shelves:
        path = write_archive(out, shelf, given.version, SHELVES[shelf](given.version))
        if given.check:
            check_archive(shelf, path)
        print(f"  {path.name}: {path.stat().st_size // 1024} kB" + (", manifest valid, example compiles" if given.check else ""))
    print(f"dist: {len(shelves)} archives, {len(shelves) if given.check else 0} checked, 0 faults")


if __name__ == "__main__":
    main()
