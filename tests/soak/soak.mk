# A long life: SOAK_COMMITS writes with random power cuts on each of six kinds of flash together, SOAK_FRAMES over a bad line.
SOAK_COMMITS ?= 1000000
SOAK_FRAMES ?= 10000000

$(BUILD)/tests/soak/soak: tests/soak/soak.c $(BUILD)/flags/torn tests/torn/torn.h tests/emu/torn_nor.h $(CORE_SOURCES) $(wildcard common/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(TORN_FLAGS) $< $(CORE_SOURCES) -o $@

soak: $(BUILD)/tests/soak/soak  ## campaign: a million commits with power cuts, ten million frames over a bad line (SOAK_COMMITS, SOAK_FRAMES, SEED)
	$(Q)$< --seed $(SEED) --commits $(SOAK_COMMITS) --frames $(SOAK_FRAMES)

.PHONY: soak

MONTH_DAYS ?= 30
$(BUILD)/tests/soak/month: tests/soak/month.c $(BUILD)/flags/torn tests/emu/torn_nor.h firmware/check/reference.h $(wildcard firmware/app/*.c) $(CORE_SOURCES) $(wildcard common/*.h firmware/app/*.h)
	@mkdir -p $(@D)
	$(Q)$(CC) $(TORN_FLAGS) -Ifirmware $< $(wildcard firmware/app/*.c) $(CORE_SOURCES) -lm -o $@

month: $(BUILD)/tests/soak/month  ## campaign: the app calibrates six axes for 30 simulated days, with faults (MONTH_DAYS, SEED)
	$(Q)$< $(MONTH_DAYS) $(SEED)

campaign-programs: $(BUILD)/tests/soak/soak $(BUILD)/tests/soak/month

.PHONY: month
