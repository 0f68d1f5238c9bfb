# The STM32F405: an image for the chip, and one for QEMU's netduinoplus2 (board.h says what differs).

CPU_stm32f405 := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 $(if $(HSE_HZ),-DSTM32_HSE_HZ=$(HSE_HZ)u) $(if $(W25Q_BASE),-DSTM32_W25Q_BASE=$(W25Q_BASE)u)
CPU_stm32f405_qemu := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -DSTM32_TIM_HZ=1000000000u -DWAIT_TURNS=10u
STM32_DRIVERS := $(addprefix firmware/port/stm32f405/,main.c startup.c system.c usart.c)
STM32_CHIP := $(addprefix firmware/port/stm32f405/,board_chip.c flash.c) firmware/sensors/sensor.c firmware/sensors/source.c
STM32_INTERNAL := firmware/port/stm32f405/board_store_chip.c
STM32_W25Q := firmware/port/stm32f405/board_store_w25q.c firmware/flash/w25q.c
STM32_ICM42688P := $(STM32_CHIP) $(addprefix firmware/port/stm32f405/,board_icm42688p.c spi.c) firmware/sensors/icm42688p.c
STM32_MPU6050 := $(STM32_CHIP) $(addprefix firmware/port/stm32f405/,board_mpu6050.c i2c.c) firmware/sensors/mpu6050.c
STM32_QEMU := firmware/port/stm32f405/board_emulated.c firmware/port/arm/semihost.c firmware/port/arm/semihost_sim.c firmware/port/arm/semihost_bus.c $(FIRMWARE_SIM) $(FIRMWARE_BUS)

# Core and application are those of the other Cortex-M4F (mps2_an386), and the chip's images share one folder of objects:
# they differ in the sources that they link.
# $1 folder in build/obj
define stm32_objects
FLAGS_$1 = $$(CROSS)gcc $$(CPU_$1) $$(FIRMWARE_CFLAGS) $$(MCU_OPTIMISE) $$(FIRMWARE_CPPFLAGS)
$(BUILD)/obj/$1/%.o: %.c $(BUILD)/flags/$1
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  CC   $$< ($1)")
	$$(Q)$$(CCACHE) $$(CROSS)gcc $$(CPU_$1) $$(FIRMWARE_CFLAGS) $$(MCU_OPTIMISE) \
	  -fstack-usage -MMD -MP $$(FIRMWARE_CPPFLAGS) -c $$< -o $$@
-include $(shell find $(BUILD)/obj/$1 -name '*.d' 2>/dev/null)
endef
$(foreach objects,stm32f405 stm32f405_qemu,$(eval $(call stm32_objects,$(objects))))

# $1 image's folder in build/firmware, $2 its objects' folder, $3 sources beside core and app
define stm32_image
$(BUILD)/firmware/$1/imucal.elf: $$(patsubst %.c,$(BUILD)/obj/mps2_an386/%.o,$$(CORE_SOURCES) $(FIRMWARE_APP)) \
  $$(patsubst %.c,$(BUILD)/obj/$2/%.o,$(STM32_DRIVERS) $3) \
  firmware/port/stm32f405/link.ld
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  LINK $$@")
	$$(Q)$$(CROSS)gcc $$(CPU_$2) -nostartfiles --specs=nano.specs -Wl,--gc-sections,--fatal-warnings,-Map=$$(@:.elf=.map) \
	  -T firmware/port/stm32f405/link.ld $$(filter %.o,$$^) -o $$@
	$$(Q)$$(CROSS)objcopy -O binary $$@ $$(@:.elf=.bin)
endef
$(eval $(call stm32_image,stm32f405,stm32f405,$(STM32_ICM42688P) $(STM32_INTERNAL)))
$(eval $(call stm32_image,stm32f405_mpu6050,stm32f405,$(STM32_MPU6050) $(STM32_INTERNAL)))
$(eval $(call stm32_image,stm32f405_w25q,stm32f405,$(STM32_ICM42688P) $(STM32_W25Q)))
$(eval $(call stm32_image,stm32f405_mpu6050_w25q,stm32f405,$(STM32_MPU6050) $(STM32_W25Q) firmware/port/stm32f405/spi.c))
$(eval $(call stm32_image,stm32f405_qemu,stm32f405_qemu,$(STM32_QEMU)))
STM32_NAMES := stm32f405 stm32f405_mpu6050 stm32f405_w25q stm32f405_mpu6050_w25q stm32f405_qemu

STM32_IMAGES := $(STM32_NAMES:%=$(BUILD)/firmware/%/imucal.elf)
firmware-stm32f405: $(STM32_IMAGES)  ## build: build the STM32F405's images (ICM-42688-P, MPU-6050, each with the tables on chip or in a W25Q), and QEMU's (HSE_HZ, W25Q_BASE)
	$(Q)$(CROSS)size $^

# FLASHER=openocd (ST-Link on SWD) or dfu (USB boot loader: BOOT0 high, reset); Debian packages openocd, dfu-util.
# SENSOR=icm42688p or mpu6050; STORE=chip (tables in the chip's own flash) or w25q; DRY=1: look for files and tools and print the
# commands, run none.  The image is written in two parts around sectors 1 and 2, so that tables in the chip stay.
FLASHER ?= openocd
SENSOR ?= icm42688p
STORE ?= chip
DRY ?=
STM32_FLASH := $(BUILD)/firmware/stm32f405$(if $(filter mpu6050,$(SENSOR)),_mpu6050)$(if $(filter w25q,$(STORE)),_w25q)
# $1 value, $2 what it may be, $3 its name
stm32_one_of = $(if $(filter $1,$2),,$(error make flash: $3=$1 is unknown; it may be: $2))
FLASH_TOOL := $(if $(filter dfu,$(FLASHER)),dfu-util,openocd)
FLASH_RUN = $(if $(DRY),@echo,)

flash: $(STM32_FLASH)/imucal.elf  ## build: write the image into an STM32F405 (FLASHER=openocd or dfu, SENSOR=icm42688p or mpu6050, STORE=chip or w25q, DRY=1); keeps the tables
	$(call stm32_one_of,$(FLASHER),openocd dfu,FLASHER)$(call stm32_one_of,$(SENSOR),icm42688p mpu6050,SENSOR)$(call stm32_one_of,$(STORE),chip w25q,STORE)
	$(Q)command -v $(FLASH_TOOL) >/dev/null || \
	  { echo "make flash: $(FLASH_TOOL) is missing; install it: apt-get install $(FLASH_TOOL)" >&2; exit 3; }
ifeq ($(FLASHER),dfu)
	$(Q)$(CROSS)objcopy -O binary -j .vectors $< $(STM32_FLASH)/vectors.bin
	$(Q)$(CROSS)objcopy -O binary -R .vectors $< $(STM32_FLASH)/program.bin
	$(FLASH_RUN) dfu-util -d 0483:df11 -a 0 -s 0x0800C000 -D $(STM32_FLASH)/program.bin
	$(FLASH_RUN) dfu-util -d 0483:df11 -a 0 -s 0x08000000:leave -D $(STM32_FLASH)/vectors.bin
else
	$(FLASH_RUN) openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c "program $< verify reset exit"
endif
.PHONY: firmware-stm32f405 flash
