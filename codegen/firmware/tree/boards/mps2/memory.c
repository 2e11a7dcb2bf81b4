/* Part of Tendon; do not edit a copy. Memory. */
#include <stddef.h>
#include <stdint.h>

/* Functions that compilers call to copy or clear memory without a C library. LLVM uses the names of Arm's EABI, whose
 * memset has its last two arguments swapped. gcc needs -fno-tree-loop-distribute-patterns here: otherwise it replaces
 * each loop by a call of the function that contains it. */

void *memcpy(void *target, const void *source, size_t count);
void *memset(void *target, int value, size_t count);
void __aeabi_memcpy(void *target, const void *source, size_t count);
void __aeabi_memset(void *target, size_t count, int value);
void __aeabi_memclr(void *target, size_t count);
void __aeabi_memcpy4(void *target, const void *source, size_t count);
void __aeabi_memset4(void *target, size_t count, int value);
void __aeabi_memclr4(void *target, size_t count);
void __aeabi_memcpy8(void *target, const void *source, size_t count);
void __aeabi_memset8(void *target, size_t count, int value);
void __aeabi_memclr8(void *target, size_t count);

void *memcpy(void *target, const void *source, size_t count)
{
    uint8_t *to = target;
    const uint8_t *from = source;
    for (size_t i = 0U; i < count; ++i) {
        to[i] = from[i];
    }
    return target;
}

void *memset(void *target, int value, size_t count)
{
    uint8_t *to = target;
    for (size_t i = 0U; i < count; ++i) {
        to[i] = (uint8_t)value;
    }
    return target;
}

void __aeabi_memcpy(void *target, const void *source, size_t count)
{
    (void)memcpy(target, source, count);
}

void __aeabi_memset(void *target, size_t count, int value)
{
    (void)memset(target, value, count);
}

void __aeabi_memclr(void *target, size_t count)
{
    (void)memset(target, 0, count);
}

void __aeabi_memcpy4(void *target, const void *source, size_t count)
{
    (void)memcpy(target, source, count);
}

void __aeabi_memset4(void *target, size_t count, int value)
{
    (void)memset(target, value, count);
}

void __aeabi_memclr4(void *target, size_t count)
{
    (void)memset(target, 0, count);
}

void __aeabi_memcpy8(void *target, const void *source, size_t count)
{
    (void)memcpy(target, source, count);
}

void __aeabi_memset8(void *target, size_t count, int value)
{
    (void)memset(target, value, count);
}

void __aeabi_memclr8(void *target, size_t count)
{
    (void)memset(target, 0, count);
}
