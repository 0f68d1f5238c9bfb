# Firmware images: the same common/*.c and firmware/app/*.c for every port, plus the port's own files.
# build/firmware/posix/imucal is a process; the others are ELF images for the chip and for QEMU.

FIRMWARE_SIM := firmware/port/sim/nor.c firmware/port/sim/sample_stream.c firmware/port/sim/board_options.c
FIRMWARE_APP := $(wildcard firmware/app/*.c)
FIRMWARE_SENSORS := $(wildcard firmware/sensors/*.c)
FIRMWARE_CPPFLAGS := -Icommon -Ifirmware
FIRMWARE_CFLAGS := -std=c99 -pedantic -ffp-contract=off -fno-common $(WARNINGS) -Wstrict-prototypes -Wdouble-promotion

# A driver of firmware/sensors in an emulated device, its bus led to a model in another process (tests/emu/sensor_server.c).
FIRMWARE_BUS := firmware/port/sim/bus_sensor.c $(FIRMWARE_SENSORS)

# Emulated ARM devices: each gets its image and the check program, and links semihosting.  A port for a chip is not one of
# them: it has a make file of its own, port/NAME/NAME.mk, read at the end (README.md, Porting).
FIRMWARE_PORTS := mps2_an386 nrf51
FIRMWARE_IMAGES := $(BUILD)/firmware/posix/imucal $(BUILD)/firmware/posix/check $(BUILD)/tests/emu/sensor_server \
                   $(FIRMWARE_PORTS:%=$(BUILD)/firmware/%/imucal.elf) \
                   $(foreach image,stm32f405 stm32f405_mpu6050 stm32f405_w25q stm32f405_mpu6050_w25q stm32f405_qemu,$(BUILD)/firmware/$(image)/imucal.elf) \
                   $(FIRMWARE_PORTS:%=$(BUILD)/firmware/%/check.elf)
firmware: $(FIRMWARE_IMAGES)  ## build: build the firmware images into build/firmware

# ---- this machine: the posix port, and what the unit tests link ----

$(BUILD)/obj/host/firmware/%.o: firmware/%.c $(BUILD)/flags/host_c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CCACHE) $(CC) $(FIRMWARE_CFLAGS) -D_GNU_SOURCE $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP $(FIRMWARE_CPPFLAGS) $(CFLAGS) -c $< -o $@

FIRMWARE_CORE_HOST := $(CORE_SOURCES:%.c=$(BUILD)/obj/host/%.o)
FIRMWARE_APP_HOST := $(patsubst %.c,$(BUILD)/obj/host/%.o,$(FIRMWARE_APP) $(FIRMWARE_SIM))
FIRMWARE_POSIX := $(patsubst %.c,$(BUILD)/obj/host/%.o,$(wildcard firmware/port/posix/*.c) $(FIRMWARE_BUS))

$(BUILD)/firmware/posix/imucal: $(FIRMWARE_POSIX) $(FIRMWARE_APP_HOST) $(FIRMWARE_CORE_HOST)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE_FLAGS) $^ $(LDFLAGS) -o $@

$(BUILD)/tests/emu/sensor_server: $(BUILD)/obj/host/tests/emu/sensor_server.o
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE_FLAGS) $^ $(LDFLAGS) -lm -o $@

# The core's check: the same log to the same bits on every machine, and what it costs.
FIRMWARE_CHECK := firmware/check/print.c firmware/check/bits.c firmware/check/profiles.c
$(BUILD)/firmware/posix/check: $(patsubst %.c,$(BUILD)/obj/host/%.o,$(FIRMWARE_CHECK) firmware/check/main_posix.c) $(FIRMWARE_CORE_HOST)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE_FLAGS) $^ $(LDFLAGS) -o $@

# Unit tests of the firmware (tests/tests.mk links every .o it finds among the prerequisites).
$(patsubst tests/%.c,$(BUILD)/tests/%,$(wildcard tests/firmware/test_*.c)): $(FIRMWARE_APP_HOST) \
  $(patsubst %.c,$(BUILD)/obj/host/%.o,$(FIRMWARE_SENSORS) $(wildcard firmware/flash/*.c)) $(BUILD)/obj/host/tests/firmware/bench.o

# What the chamber and the gyros do in test_sensor_job: a log by gyrosim.
$(BUILD)/tests/firmware/sensor_job.csv: tests/firmware/sensor_job_model.json tests/firmware/sensor_job_profile.json | $(BUILD)/bin/gyrosim
	@mkdir -p $(@D)
	$(if $(V),,@echo "  GEN  $@")
	$(Q)$(BUILD)/bin/gyrosim log --model $< --profile $(word 2,$^) --axes 3 --seed 1 -q -o $@
$(BUILD)/tests/firmware/test_sensor_job: | $(BUILD)/tests/firmware/sensor_job.csv

# ---- microcontrollers ----

FIRMWARE_ARM := firmware/port/arm/startup.c firmware/port/arm/semihost.c firmware/port/arm/semihost_sim.c
CPU_mps2_an386 := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16
CPU_nrf51 := -mcpu=cortex-m0 -mthumb -DCHECK_NRF51
DRIVER_mps2_an386 := firmware/port/arm/cmsdk.c
# Floats of the M0: usual numbers faster than libgcc does them, the same bits (port/arm/float_v6m.h).
DRIVER_nrf51 := firmware/port/nrf51/nrf51.c firmware/port/arm/float_v6m.c
LINK_nrf51 := $(addprefix -Wl$(comma)--wrap=__aeabi_f,mul add sub div)
PORT_mps2_an386 := firmware/port/mps2_an386/main.c $(DRIVER_mps2_an386)
PORT_nrf51 := firmware/port/nrf51/main.c $(DRIVER_nrf51)

# Small everywhere; on the Cortex-M4F fast where it runs with every sample (make cycles, make size show the trade).
# -fno-tree-pre: else comp's steps share the sign extension of their common factor, and give up the one multiplication that
# needs none (order 5: 89 instructions for 72).
# On the Cortex-M0 -O2 is larger and, with the float arithmetic in the library, no faster.
MCU_OPTIMISE := $(if $(DEBUG),-Og,-Os) -g1 -ffunction-sections -fdata-sections
FAST_mps2_an386_comp := -O2 -fno-tree-pre
FAST_mps2_an386_sum := -O2
FAST_nrf51_float_v6m := -O2

# $1 port
define mcu_rules
FLAGS_$1 = $$(CROSS)gcc $$(CPU_$1) $$(FIRMWARE_CFLAGS) $$(MCU_OPTIMISE) $$(FIRMWARE_CPPFLAGS) $$(LINK_$1)
$(BUILD)/obj/$1/%.o: %.c $(BUILD)/flags/$1
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  CC   $$< ($1)")
	$$(Q)$$(CCACHE) $$(CROSS)gcc $$(CPU_$1) $$(FIRMWARE_CFLAGS) $$(if $$(filter common/%,$$<),-ffreestanding) \
	  $$(MCU_OPTIMISE) $$(if $$(DEBUG),,$$(FAST_$1_$$(basename $$(<F)))) -fstack-usage -MMD -MP $$(FIRMWARE_CPPFLAGS) -c $$< -o $$@

CORE_$1 := $$(CORE_SOURCES:%.c=$(BUILD)/obj/$1/%.o)
OBJECTS_$1_imucal := $$(CORE_$1) $$(patsubst %.c,$(BUILD)/obj/$1/%.o,$(FIRMWARE_APP) $(FIRMWARE_SIM) $(FIRMWARE_ARM) $(PORT_$1))
OBJECTS_$1_check := $$(CORE_$1) $$(patsubst %.c,$(BUILD)/obj/$1/%.o,$(FIRMWARE_CHECK) firmware/check/cost.c \
  firmware/check/main_arm.c firmware/port/arm/startup.c firmware/port/arm/semihost.c $(DRIVER_$1))

.SECONDEXPANSION:
$(BUILD)/firmware/$1/%.elf: $$$$(OBJECTS_$1_$$$$*) firmware/port/$1/link.ld firmware/port/arm/sections.ld
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  LINK $$@")
	$$(Q)$$(CROSS)gcc $$(CPU_$1) -nostartfiles --specs=nano.specs -Wl,--gc-sections,--fatal-warnings,-Map=$$(@:.elf=.map) \
	  -Lfirmware/port/arm -T firmware/port/$1/link.ld $$(LINK_$1) $$(filter %.o,$$^) -o $$@
endef
$(foreach port,$(FIRMWARE_PORTS),$(eval $(call mcu_rules,$(port))))
.SECONDARY: $(foreach port,$(FIRMWARE_PORTS),$(OBJECTS_$(port)_imucal) $(OBJECTS_$(port)_check))

-include $(shell find $(BUILD)/obj/mps2_an386 $(BUILD)/obj/nrf51 -name '*.d' 2>/dev/null)

include $(sort $(wildcard firmware/port/*/*.mk))
include firmware/examples/examples.mk

# ---- what it costs (firmware/cost.py --help) ----

COST := python3 firmware/cost.py --build $(BUILD) --cross $(CROSS)
size: firmware  ## figure: flash of each core object, RAM of its structures, on Cortex-M4F and Cortex-M0
	@$(COST) size
stack: firmware  ## figure: worst stack of the firmware: call graph, and painted stack in QEMU
	@$(COST) stack
cycles: firmware  ## figure: instructions per call of the core's functions, counted in QEMU
	@$(COST) cycles
cost-diff: firmware  ## figure: all three against firmware/cost_baseline.json (cost.py save writes it)
	@$(COST) diff

sensor-table: firmware host  ## figure: what stands behind each sensor driver: lines, checks, faults injected and found
	$(Q)BUILD=$(BUILD) $(PYTHON) tests/emu/sensor_table.py
.PHONY: size stack cycles cost-diff sensor-table
