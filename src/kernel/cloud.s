@ void freshet_cloud(Cluster *, const Row *, i32 sums[], i32 drive[], i32 out[][2], steps, clusters, i32 ring_out)
@ The frame: what changes, then what stays.
    .set    CLOUD_OUT, 0
    .set    CLOUD_STEPS, 4
    .set    CLOUD_DRIVE_END, 8
    .set    CLOUD_SUMS_END, 12
    .set    CLOUD_CLUSTERS_END, 16
    .set    CLOUD_ARGUMENTS, 20             @ clusters, core, sums, drive
    .set    CLOUD_STACKED, 36 + 36          @ out, steps, clusters, ring_out

@ r0 drive  r1 core  r2-r9 sums  lr total  r10-r12 words
    .macro  cloud_row first
    ldm     r1!, {{r10-r12}}
    .if     \first
    smmulr  lr, r2, r10
    .else
    ldr     lr, [r0]
    smmlar  lr, r2, r10, lr
    .endif
    smmlar  lr, r3, r11, lr
    smmlar  lr, r4, r12, lr
    ldm     r1!, {{r10-r12}}
    smmlar  lr, r5, r10, lr
    smmlar  lr, r6, r11, lr
    smmlar  lr, r7, r12, lr
    ldm     r1!, {{r10, r11}}
    smmlar  lr, r8, r10, lr
    smmlar  lr, r9, r11, lr
    str     lr, [r0], #4
    .endm

@ r0 mode  r3 k  r4 c  r5 g  r6 y  r7:r8 v  r9 drive  r10:r11 sum  r12 free
    .macro  cloud_mode first
    ldm     r0!, {{r3-r8}}
    smlal   r7, r8, r4, r8
    smlal   r7, r8, r3, r6
    smlal   r7, r8, r5, r9
    add     r6, r6, r8, lsl #3
    smmulr  r12, r3, r6
    smmlar  r12, r4, r8, r12
    .if     \first
    smull   r10, r11, r5, r12
    .else
    smlal   r10, r11, r5, r12
    .endif
    stmdb   r0, {{r6-r8}}
    .endm

    .section .text.freshet_cloud, "ax", %progbits
    .balign 16
    .global freshet_cloud
    .type   freshet_cloud, %function
    .thumb_func
freshet_cloud:
    push    {{r4-r11, lr}}
    push    {{r0-r3}}
    sub     sp, sp, #20
    ldrd    r4, r5, [sp, #CLOUD_STACKED]    @ out, steps
    ldr     r6, [sp, #CLOUD_STACKED + 8]
    strd    r4, r5, [sp, #CLOUD_OUT]
    add     r7, r3, r6, lsl #2
    adds    r7, #8
    str     r7, [sp, #CLOUD_DRIVE_END]
    add     r7, r2, r6, lsl #2
    str     r7, [sp, #CLOUD_SUMS_END]
    adds    r6, #1
    add     r7, r0, r6, lsl #9
    str     r7, [sp, #CLOUD_CLUSTERS_END]

1:  ldr     lr, [sp, #CLOUD_ARGUMENTS + 8]
    ldr     r1, [sp, #CLOUD_ARGUMENTS + 4]
    ldr     r0, [sp, #CLOUD_ARGUMENTS + 12]
    ldm     lr!, {{r2-r9}}
    push    {{lr}}
2:  cloud_row 1
    cloud_row 1
    ldr     r10, [sp, #CLOUD_DRIVE_END + 4]
    cmp     r0, r10
    bne     2b
3:  pop     {{lr}}
    ldr     r10, [sp, #CLOUD_SUMS_END]
    cmp     lr, r10
    beq     5f
    ldr     r0, [sp, #CLOUD_ARGUMENTS + 12]
    ldm     lr!, {{r2-r9}}
    push    {{lr}}
4:  cloud_row 0
    cloud_row 0
    ldr     r10, [sp, #CLOUD_DRIVE_END + 4]
    cmp     r0, r10
    bne     4b
    b       3b

5:  ldr     r1, [sp, #CLOUD_ARGUMENTS + 12]
    ldr     r3, [r10]                       @ what rings out
    ldr     r4, [sp, #CLOUD_STACKED + 12]
    ldr     r7, [sp, #CLOUD_OUT]
    smmulr  r3, r3, r4
    ldm     r1!, {{r5, r6}}
    add     r5, r3
    add     r6, r3
    stm     r7!, {{r5, r6}}
    str     r7, [sp, #CLOUD_OUT]
    ldr     r2, [sp, #CLOUD_ARGUMENTS + 8]
    ldr     r0, [sp, #CLOUD_ARGUMENTS]
    ldr     lr, [sp, #CLOUD_CLUSTERS_END]
@ r0 mode  r1 drive  r2 sum  lr end
6:  ldr     r9, [r1], #4
    cloud_mode 1
    .rept   7
    cloud_mode 0
    .endr
    lsl     r11, r11, #11
    orr     r11, r11, r10, lsr #21
    str     r11, [r2], #4
    add     r0, r0, #320
    cmp     r0, lr
    bne     6b
    ldr     r3, [sp, #CLOUD_STEPS]
    subs    r3, #1
    str     r3, [sp, #CLOUD_STEPS]
    bne.w   1b
    add     sp, sp, #36
    pop     {{r4-r11, pc}}
    .size   freshet_cloud, . - freshet_cloud
    .purgem cloud_row
    .purgem cloud_mode
    .text
