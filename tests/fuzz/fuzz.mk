# Random and mutated bytes into the core, under the sanitizers.  FUZZ_SECONDS, SEED.  With clang there is libFuzzer too.
FUZZ_SECONDS ?= 20
FUZZ_CLANG ?= clang-14
FUZZ_FLAGS := -std=c99 -g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all -Icommon -Itests -D_GNU_SOURCE

$(BUILD)/tests/fuzz/fuzz_core: tests/fuzz/fuzz_core.c $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(FUZZ_FLAGS) -DIMUCAL_FUZZ_MAIN $< $(CORE_SOURCES) -lcmocka -lm -o $@

$(BUILD)/tests/fuzz/libfuzzer_core: tests/fuzz/fuzz_core.c $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(FUZZ_CLANG) $(FUZZ_FLAGS) -fsanitize=fuzzer $< $(CORE_SOURCES) -o $@

fuzz:: $(BUILD)/tests/fuzz/fuzz_core  ## random bytes into link receiver and table decoder, under ASan and UBSan
	$(Q)$< $(FUZZ_SECONDS) $(SEED)

fuzz-clang:: $(BUILD)/tests/fuzz/libfuzzer_core  ## the same by libFuzzer (needs clang-14)
	$(Q)mkdir -p $(BUILD)/fuzz_corpus && $< -max_total_time=$(FUZZ_SECONDS) -seed=$(SEED) -max_len=2048 -print_final_stats=1 $(BUILD)/fuzz_corpus

.PHONY: fuzz fuzz-clang
