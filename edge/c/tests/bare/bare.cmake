# An Arm processor with GCC, by the options in PROCESSOR, and with board.c instead of an SDK.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_C_FLAGS_INIT "$ENV{PROCESSOR} -ffreestanding -ffunction-sections -I${CMAKE_CURRENT_LIST_DIR}")
set(CMAKE_CXX_FLAGS_INIT "${CMAKE_C_FLAGS_INIT} -fno-exceptions -fno-rtti")
set(CMAKE_EXE_LINKER_FLAGS_INIT
  "$ENV{PROCESSOR} -nostdlib -Wl,--gc-sections -L${CMAKE_CURRENT_LIST_DIR}/../../../.. -Wl,-T,memory.x -Wl,-T,${CMAKE_CURRENT_LIST_DIR}/sections.ld")
