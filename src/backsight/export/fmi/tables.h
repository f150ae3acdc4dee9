/* Large tables are no part of the code, which would hold them in every library and in the sources:
 * they are in the folder of resources, 8 bytes a number, the lowest first (IEEE 754). */
#ifndef TABLES_H
#define TABLES_H

#include <stdint.h>

/* Read all of them; whether that went well. */
static bool read_tables(const char *folder, double *tables)
{
    char path[4096];
    unsigned char bytes[8];
    FILE *file;
    int i, k, end;
    const size_t length = folder == NULL ? 0 : strlen(folder);
    const bool ended = length > 0 && (folder[length - 1] == '/' || folder[length - 1] == '\\');
    if (length == 0 || length + sizeof "/tables.bin" > sizeof path)
        return false;
    (void)snprintf(path, sizeof path, "%s%stables.bin", folder, ended ? "" : "/");
    file = fopen(path, "rb");
    if (file == NULL)
        return false;
    for (i = 0; i < MODEL_TABLES && fread(bytes, 1, sizeof bytes, file) == sizeof bytes; ++i) {
        uint64_t bits = 0;
        for (k = 7; k >= 0; --k)
            bits = bits << 8 | bytes[k];
        memcpy(tables + i, &bits, sizeof bits);
    }
    end = fgetc(file);
    (void)fclose(file);
    return i == MODEL_TABLES && end == EOF;
}

#endif
