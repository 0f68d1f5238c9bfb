# The compiled part of the Python package: build/python/_core.so, found there by the package in host/python; and the
# package installed into the venv.
PY_NANOBIND = $(shell $(PYTHON) -c 'import nanobind; print(nanobind.include_dir())' 2>/dev/null)
PY_INCLUDE = $(shell $(PYTHON) -c 'import sysconfig; print(sysconfig.get_path("include"))')
PY_CORE := $(BUILD)/python/_core.so
# The rooms that it takes: the objects of the host programs, position independent as they are.
PY_CORE_ROOMS := $(patsubst %,$(BUILD)/lib/%.a,analysis/fit analysis/errormodel analysis/dp physics/sim physics/effects noise linear io base common)

FLAGS_python = $(CXX) $(HOST_CPPFLAGS)
# nanobind's own source, and what includes it: not held to our warnings.
$(BUILD)/obj/pic/host/python/native/%.o: host/python/native/%.cpp $(BUILD)/flags/python
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $< (pic)")
	$(Q)$(CCACHE) $(CXX) -std=c++17 -ffp-contract=off -O2 -fPIC -fvisibility=hidden -fno-strict-aliasing -Wall -Wextra -MMD -MP $(HOST_CPPFLAGS) \
	  -isystem $(PY_NANOBIND) -isystem $(PY_NANOBIND)/../ext/robin_map/include -isystem $(PY_INCLUDE) -c $< -o $@

$(BUILD)/obj/pic/nanobind.o: $(BUILD)/flags/python
	@mkdir -p $(@D)
	@[ -n "$(PY_NANOBIND)" ] || { echo "imucal: the Python library nanobind is missing: make deps" >&2; exit 1; }
	@echo "  CXX  nanobind"
	$(Q)$(CCACHE) $(CXX) -std=c++17 -O2 -fPIC -fvisibility=hidden -fno-strict-aliasing -DNDEBUG -DNB_COMPACT_ASSERTIONS -isystem $(PY_INCLUDE) -I$(PY_NANOBIND) \
	  -I$(PY_NANOBIND)/../ext/robin_map/include -c $(PY_NANOBIND)/../src/nb_combined.cpp -o $@

$(PY_CORE): $(BUILD)/obj/pic/nanobind.o $(BUILD)/obj/pic/host/python/native/core.o $(PY_CORE_ROOMS)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -shared -pthread $^ -o $@ -Wl,--gc-sections $(HOST_LIBS)

python-core: $(PY_CORE)  ## build: build the compiled part of the Python package

python:  ## build: install the Python package imucal into build/venv
	@$(MAKE) --no-print-directory deps
	$(Q)$(PYTHON) -m pip install --quiet --disable-pip-version-check ./host/python
	@$(PYTHON) -I -c 'import imucal, numpy; c = imucal.allan_deviation(numpy.random.default_rng(1).normal(size=1000)); print("imucal", imucal.__version__, "installed:", len(c.tau_s), "points of an Allan deviation")'

formats-table: $(PY_CORE)  ## figure: the importers' table: fields, round-trip error, real files, MB/s; a 100-MB ULog against pyulog
	$(Q)IMUCAL_BIN=$(abspath $(BUILD))/bin $(PYTHON) tests/bench/bench_import.py

bench-package: $(PY_CORE) $(BUILD)/tests/bench_dp  ## figure: allan_deviation of the Python package against the C++ time
	$(Q)$(PYTHON) tests/bench/bench_package.py --build $(BUILD)

system-test: $(PY_CORE)

-include $(shell find $(BUILD)/obj/pic -name '*.d' 2>/dev/null)

.PHONY: python python-core formats-table bench-package
