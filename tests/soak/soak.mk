# A long life: SOAK_COMMITS writes with random power cuts on each of six kinds of flash together, SOAK_FRAMES over a bad line.
SOAK_COMMITS ?= 1000000
SOAK_FRAMES ?= 10000000

$(BUILD)/tests/soak/soak: tests/soak/soak.c tests/torn/torn.h tests/emu/nor.h $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(TORN_FLAGS) $< $(CORE_SOURCES) -o $@

soak: $(BUILD)/tests/soak/soak  ## a million commits with power cuts, ten million frames over a bad line (SOAK_COMMITS, SOAK_FRAMES, SEED)
	$(Q)$< --seed $(SEED) --commits $(SOAK_COMMITS) --frames $(SOAK_FRAMES)

.PHONY: soak
