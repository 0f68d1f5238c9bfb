# The STM32F405: an image for the chip, and one for QEMU's netduinoplus2 (board.h says what differs).

CPU_stm32f405 := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 $(if $(HSE_HZ),-DSTM32_HSE_HZ=$(HSE_HZ)u)
CPU_stm32f405_mpu6050 := $(CPU_stm32f405)
CPU_stm32f405_qemu := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -DSTM32_TIM_HZ=1000000000u -DWAIT_TURNS=10u
FAST_stm32f405_comp := -O2 -fno-tree-pre
FAST_stm32f405_sum := -O2
FAST_stm32f405_qemu_comp := -O2 -fno-tree-pre
FAST_stm32f405_qemu_sum := -O2
STM32_DRIVERS := $(addprefix firmware/port/stm32f405/,main.c startup.c system.c usart.c)
STM32_CHIP := $(addprefix firmware/port/stm32f405/,board_chip.c flash.c) firmware/sensors/sensor.c firmware/sensors/source.c
STM32_ICM42688P := $(STM32_CHIP) $(addprefix firmware/port/stm32f405/,board_icm42688p.c spi.c) firmware/sensors/icm42688p.c
STM32_MPU6050 := $(STM32_CHIP) $(addprefix firmware/port/stm32f405/,board_mpu6050.c i2c.c) firmware/sensors/mpu6050.c
STM32_QEMU := firmware/port/stm32f405/board_emulated.c firmware/port/arm/semihost.c firmware/port/arm/semihost_sim.c firmware/port/arm/semihost_bus.c $(FIRMWARE_SIM) $(FIRMWARE_BUS)

# $1 image's folder in build/, $2 sources beside core and app
define stm32_rules
$(BUILD)/obj/$1/%.o: %.c
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  CC   $$< ($1)")
	$$(Q)$$(CCACHE) $$(CROSS)gcc $$(CPU_$1) $$(FIRMWARE_CFLAGS) $$(if $$(filter common/%,$$<),-ffreestanding) \
	  $$(MCU_OPTIMISE) $$(if $$(DEBUG),,$$(FAST_$1_$$(basename $$(<F)))) -fstack-usage -MMD -MP $$(FIRMWARE_CPPFLAGS) -c $$< -o $$@

$(BUILD)/firmware/$1/imucal.elf: $$(patsubst %.c,$(BUILD)/obj/$1/%.o,$$(CORE_SOURCES) $(FIRMWARE_APP) $(STM32_DRIVERS) $2) \
  firmware/port/stm32f405/link.ld
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  LINK $$@")
	$$(Q)$$(CROSS)gcc $$(CPU_$1) -nostartfiles --specs=nano.specs -Wl,--gc-sections,--fatal-warnings,-Map=$$(@:.elf=.map) \
	  -T firmware/port/stm32f405/link.ld $$(filter %.o,$$^) -o $$@
	$$(Q)$$(CROSS)objcopy -O binary $$@ $$(@:.elf=.bin)
endef
$(eval $(call stm32_rules,stm32f405,$(STM32_ICM42688P)))
$(eval $(call stm32_rules,stm32f405_mpu6050,$(STM32_MPU6050)))
$(eval $(call stm32_rules,stm32f405_qemu,$(STM32_QEMU)))
-include $(shell find $(BUILD)/obj/stm32f405 $(BUILD)/obj/stm32f405_mpu6050 $(BUILD)/obj/stm32f405_qemu -name '*.d' 2>/dev/null)

STM32_IMAGES := $(foreach image,stm32f405 stm32f405_mpu6050 stm32f405_qemu,$(BUILD)/firmware/$(image)/imucal.elf)
firmware-stm32f405: $(STM32_IMAGES)  ## build the STM32F405's images (ICM-42688-P, MPU-6050), and the one for QEMU's netduinoplus2 (HSE_HZ=8000000)
	$(Q)$(CROSS)size $^

# FLASHER=openocd (ST-Link on SWD) or dfu (USB boot loader: BOOT0 high, reset); Debian packages openocd, dfu-util.
FLASHER ?= openocd
SENSOR ?= icm42688p
STM32_FLASH := $(BUILD)/firmware/$(if $(filter mpu6050,$(SENSOR)),stm32f405_mpu6050,stm32f405)
flash: $(STM32_FLASH)/imucal.elf  ## write the image into an STM32F405 (FLASHER=openocd or dfu, SENSOR=icm42688p or mpu6050); keeps the tables
	$(Q)command -v $(if $(filter dfu,$(FLASHER)),dfu-util,openocd) >/dev/null || \
	  { echo "make flash: $(FLASHER) is missing; install it: apt-get install openocd dfu-util" >&2; exit 2; }
ifeq ($(FLASHER),dfu)
	$(Q)$(CROSS)objcopy -O binary -j .vectors $< $(STM32_FLASH)/vectors.bin
	$(Q)$(CROSS)objcopy -O binary -R .vectors $< $(STM32_FLASH)/program.bin
	dfu-util -d 0483:df11 -a 0 -s 0x0800C000 -D $(STM32_FLASH)/program.bin
	dfu-util -d 0483:df11 -a 0 -s 0x08000000:leave -D $(STM32_FLASH)/vectors.bin
else
	openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c "program $< verify reset exit"
endif
.PHONY: firmware-stm32f405 flash
