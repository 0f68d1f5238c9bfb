# Random and mutated bytes into the core, under the sanitizers.  FUZZ_SECONDS, SEED.  With clang there is libFuzzer too.
FUZZ_SECONDS ?= 20
FUZZ_CLANG ?= clang-14
FUZZ_FLAGS := -std=c99 -g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all -Icommon -Itests -D_GNU_SOURCE
FLAGS_fuzz = $(CC) $(FUZZ_CLANG) $(FUZZ_FLAGS)

$(BUILD)/tests/fuzz/fuzz_core: tests/fuzz/fuzz_core.c $(BUILD)/flags/fuzz $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(FUZZ_FLAGS) -DIMUCAL_FUZZ_MAIN $< $(CORE_SOURCES) -lcmocka -lm -o $@

$(BUILD)/tests/fuzz/libfuzzer_core: tests/fuzz/fuzz_core.c $(BUILD)/flags/fuzz $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(FUZZ_CLANG) $(FUZZ_FLAGS) -fsanitize=fuzzer $< $(CORE_SOURCES) -o $@

fuzz:: $(BUILD)/tests/fuzz/fuzz_core  ## campaign: random bytes into link receiver and table decoder, under ASan and UBSan
	$(Q)$< $(FUZZ_SECONDS) $(SEED)

fuzz-clang:: $(BUILD)/tests/fuzz/libfuzzer_core  ## campaign: as fuzz, by libFuzzer (needs clang-14)
	$(Q)mkdir -p $(BUILD)/fuzz_corpus && $< -max_total_time=$(FUZZ_SECONDS) -seed=$(SEED) -max_len=2048 -print_final_stats=1 $(BUILD)/fuzz_corpus

.PHONY: fuzz fuzz-clang

# The whole app: operations chosen by libFuzzer's coverage where clang is there (FUZZ_CLANG), else drawn at random.
FUZZ_INPUTS ?= 20000
FUZZ_DEVICE_SOURCES := $(wildcard firmware/app/*.c)
FUZZ_DEVICE_NEEDS := tests/fuzz/fuzz_device.c $(BUILD)/flags/fuzz tests/fuzz/fuzz_device.h tests/emu/torn_nor.h firmware/check/reference.h $(FUZZ_DEVICE_SOURCES) $(CORE_SOURCES) \
                     $(wildcard common/*.h firmware/app/*.h)
$(BUILD)/tests/fuzz/fuzz_device: $(FUZZ_DEVICE_NEEDS)
	@mkdir -p $(@D)
	$(Q)$(CC) $(FUZZ_FLAGS) -Ifirmware -DFUZZ_DEVICE_MAIN $< $(FUZZ_DEVICE_SOURCES) $(CORE_SOURCES) -o $@
$(BUILD)/tests/fuzz/libfuzzer_device: $(FUZZ_DEVICE_NEEDS)
	@mkdir -p $(@D)
	$(Q)$(FUZZ_CLANG) $(FUZZ_FLAGS) -Ifirmware -fsanitize=fuzzer $< $(FUZZ_DEVICE_SOURCES) $(CORE_SOURCES) -o $@

fuzz-device: $(BUILD)/tests/fuzz/fuzz_device  ## campaign: random operations on the whole app, then by libFuzzer (FUZZ_INPUTS, FUZZ_SECONDS, SEED)
	$(Q)$< $(FUZZ_INPUTS) $(SEED) 2>$(BUILD)/tests/fuzz/fuzz_device.log || { tail -3 $(BUILD)/tests/fuzz/fuzz_device.log; exit 1; }
	$(Q)command -v $(FUZZ_CLANG) >/dev/null || { echo "fuzz-device: SKIP: no $(FUZZ_CLANG) for libFuzzer (apt-get install clang-14)"; exit 0; }; \
	$(MAKE) --no-print-directory $(BUILD)/tests/fuzz/libfuzzer_device && mkdir -p $(BUILD)/fuzz_device_corpus && \
	$(BUILD)/tests/fuzz/libfuzzer_device -max_total_time=$(FUZZ_SECONDS) -seed=$(SEED) -max_len=1000 -print_final_stats=1 -verbosity=0 \
	  -artifact_prefix=$(BUILD)/tests/fuzz/ $(BUILD)/fuzz_device_corpus

campaign-programs: $(BUILD)/tests/fuzz/fuzz_core $(BUILD)/tests/fuzz/fuzz_device $(BUILD)/obj/host/tests/fuzz/fuzz_files.o

.PHONY: fuzz-device

# The files that the host programs read, by libFuzzer's coverage; all of the library that it meets is instrumented, in a
# build folder of its own.  Begins with tests/fuzz/corpus; what it finds new stays in build/fuzz_files_corpus.
FUZZ_FILES_RUNS ?= 1000000
FUZZ_FILES_SECONDS ?= 0
FUZZ_CXX ?= clang++-14
FUZZ_FILES_ROOMS := analysis/fit physics/sim physics/effects noise linear io base
FUZZ_FILES_FLAGS := -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all
$(BUILD)/tests/fuzz/libfuzzer_files: $(BUILD)/obj/host/tests/fuzz/fuzz_files.o $(patsubst %,$(BUILD)/lib/%.a,$(FUZZ_FILES_ROOMS) common)
	@mkdir -p $(@D)
	$(Q)$(CXX) -pthread -fsanitize=fuzzer,address,undefined $(filter %.o,$^) $(filter %.a,$^) $(LDFLAGS) $(HOST_LIBS) -o $@

fuzz-files-program:
	$(Q)command -v $(FUZZ_CXX) >/dev/null || { echo "fuzz-files needs libFuzzer; install it with: apt-get install clang-14" >&2; exit 3; }
	$(Q)$(MAKE) --no-print-directory BUILD=$(BUILD)/fuzz VENV=$(VENV) CC=$(FUZZ_CLANG) CXX=$(FUZZ_CXX) PCH= \
	  SANITIZE_FLAGS='$(FUZZ_FILES_FLAGS)' $(BUILD)/fuzz/tests/fuzz/libfuzzer_files

fuzz-files: fuzz-files-program  ## campaign: logs, JSON and tables by libFuzzer under ASan and UBSan (FUZZ_FILES_RUNS, FUZZ_FILES_SECONDS, SEED)
	$(Q)mkdir -p $(BUILD)/fuzz_files_corpus $(BUILD)/tests/fuzz && $(BUILD)/fuzz/tests/fuzz/libfuzzer_files -runs=$(FUZZ_FILES_RUNS) -max_total_time=$(FUZZ_FILES_SECONDS) -seed=$(SEED) -max_len=4096 \
	  -dict=tests/fuzz/files.dict -timeout=20 -print_final_stats=1 -verbosity=0 -artifact_prefix=$(BUILD)/tests/fuzz/ \
	  $(BUILD)/fuzz_files_corpus tests/fuzz/corpus

.PHONY: fuzz-files fuzz-files-program

# The files of other programs that the Python package imports, and JSON: damage at random, each batch in a process of its own.
FUZZ_IMPORTS_RUNS ?= 20000
fuzz-imports: python  ## campaign: damaged ULog, .bin, bags, .mat, tables, JSON: taken or refused by name (FUZZ_IMPORTS_RUNS, SEED)
	$(Q)$(PYTHON) tests/fuzz/fuzz_imports.py --runs $(FUZZ_IMPORTS_RUNS) --seed $(SEED) --keep $(BUILD)/fuzz_imports

.PHONY: fuzz-imports
