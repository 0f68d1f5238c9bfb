# 32-bit RISC-V without floating point, in QEMU's `virt`.  Its own target: it needs gcc-riscv64-unknown-elf and picolibc, which
# nothing else does.

CROSS_RISCV ?= riscv64-unknown-elf-
RISCV_FLAGS := -march=rv32imac -misa-spec=2.2 -mabi=ilp32 -mcmodel=medlow --specs=picolibc.specs $(FIRMWARE_CFLAGS) -Os -ffunction-sections -fdata-sections
RISCV_SOURCES := $(wildcard firmware/port/riscv_virt/*.c) $(FIRMWARE_APP) $(FIRMWARE_SIM) $(FIRMWARE_BUS) $(addprefix firmware/port/arm/semihost,.c _sim.c _bus.c)

FLAGS_riscv_virt = $(CROSS_RISCV)gcc $(RISCV_FLAGS) $(FIRMWARE_CPPFLAGS)
$(BUILD)/obj/riscv_virt/%.o: %.c $(BUILD)/flags/riscv_virt
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $< (riscv_virt)")
	$(Q)$(CCACHE) $(CROSS_RISCV)gcc $(RISCV_FLAGS) -MMD -MP $(FIRMWARE_CPPFLAGS) -c $< -o $@

$(BUILD)/firmware/riscv_virt/imucal.elf: $(patsubst %.c,$(BUILD)/obj/riscv_virt/%.o,$(CORE_SOURCES) $(RISCV_SOURCES)) firmware/port/riscv_virt/link.ld
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CROSS_RISCV)gcc $(RISCV_FLAGS) -nostartfiles -Wl,--gc-sections,--no-warn-rwx-segments -T firmware/port/riscv_virt/link.ld $(filter %.o,$^) -o $@

firmware-riscv: $(BUILD)/firmware/riscv_virt/imucal.elf  ## build: build the image for QEMU's RISC-V (apt-get install gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc)
	$(Q)$(CROSS_RISCV)size $<
.PHONY: firmware-riscv
-include $(shell find $(BUILD)/obj/riscv_virt -name '*.d' 2>/dev/null)
