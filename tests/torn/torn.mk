# Power cuts in the store: every unit of every program, inside every erase, twice in full, three times sampled.  SEED.
TORN_THREE ?= 100000
TORN_FLAGS := -std=c99 -O2 -ffp-contract=off $(WARNINGS) -Wno-conversion -Icommon -Itests -D_GNU_SOURCE
FLAGS_torn = $(CC) $(TORN_FLAGS)

$(BUILD)/tests/torn/torn: tests/torn/torn.c $(BUILD)/flags/torn tests/torn/torn.h tests/emu/torn_nor.h $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(TORN_FLAGS) $< $(CORE_SOURCES) -o $@

torn: $(BUILD)/tests/torn/torn  ## campaign: power cuts everywhere in the flash store (TORN_THREE, SEED); exit 1 on any loss
	$(Q)$< --seed $(SEED) --three $(TORN_THREE)

campaign-programs: $(BUILD)/tests/torn/torn

.PHONY: torn
