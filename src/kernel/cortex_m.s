    .syntax unified
    .thumb

@ A function's own frame, from the stack pointer up: the stream; a hit that is the end, for a block without others, whose
@ first two words `walk` has for the end of its list and the room that there was; then what an end points at: the state's
@ address and where to go on. Nothing above the stream is ever below the stack pointer.
    .set    STREAM, {stream}
    .set    LIST_END, STREAM
    .set    ROOM, STREAM + 4
    .set    HOME, STREAM + 16
    .set    WALK, STREAM + 24
@ In a Walk: resonator, tuning, flow, clock, classes to go; then these.
    .set    SOURCE, 20
    .set    OUT, 24
    .set    SWING, 32
@ Bytes of code a frame of the circle form, and two frames of the direct form.
    .set    CIRCLE_FRAME, 36
    .set    DIRECT_PAIR, 80
@ No word of a hit's is that: the end.
    .set    END, 0x80000000

@ From the hit's frame, in the upper bits of r5, the words that enter the loop; r6 right  r7 left  r11 first  lr second
@ r2 stream  r4 what the last one left, at first as after frame \at.
    .macro  enter_circle shift
    lsr     r8, r5, #\shift
    add     r8, r8, r8, lsl #3
    sub     r5, r4, r8, lsl #2
    ldr     r4, =freshet_circle_hit
    add     r4, r4, r8, lsl #2
    stm     r2!, {{r5, r6, r7, r11, lr}}
    .endm
@ The same for the end of a block.
    .macro  end_circle
    sub     r5, r4, #31 * CIRCLE_FRAME
    stm     r2!, {{r5, r6, r7, r11, lr}}
    .endm
    .macro  first_circle at
    ldr     r4, =freshet_circle_hit + \at * CIRCLE_FRAME
    .endm

@ What the loops have in registers, from r12 state  r1 where the coefficients are  r0 frame.
@ r0 frame  r1 g  r2 -g  r3 -b  r4:r5 y  r6:r7 v, left  r8:r9 y  r10:r11 v, right  r12, lr free
    .macro  registers_circle at
    ldrd    r2, r3, [r1, #\at]
    rsb     r1, r2, #0
    ldm     r12, {{r4-r11}}
    .endm
@ r0 frame  r1 a1  r2 a2  r4 y  r5 y1, left  r6 y  r7 y1, right  r8-r11 two frames  r3, r12, lr free
    .macro  registers_direct at
    ldrd    r1, r2, [r1, #\at]
    ldr     r4, [r12, #4]
    ldr     r5, [r12, #12]
    ldr     r6, [r12, #20]
    ldr     r7, [r12, #28]
    .endm

    .macro  place_direct
    sub     r8, r5, r4
    mov     r4, r5
    lsr     r9, r8, #1
    add     r9, r9, r9, lsl #2
    ldr     r10, =freshet_direct_hit
    sub     r5, r10, r9, lsl #4
    lsls    r8, r8, #31
    itt     ne
    ldrne   r9, =freshet_direct_odd
    strne   r9, [r2], #4
    stm     r2!, {{r5, r6, r7, r11, lr}}
    .endm
    .macro  enter_direct shift
    lsr     r5, r5, #\shift
    place_direct
    .endm
    .macro  end_direct
    mov     r5, #31
    place_direct
    .endm
    .macro  first_direct at
    mov     r4, #\at
    .endm

@ u64 freshet_walk(Walk *)
@ Lower word: how many births are listed. Upper: 0 all classes are done; else the walk stands at a class that is left to
@ the caller: 1 untouched, 2 with its births listed, 3 listed and there may be more.
    .section .text.freshet_walk, "ax", %progbits
    .balign 16
    .global freshet_walk
    .type   freshet_walk, %function
    .thumb_func
freshet_walk:
    push    {{r0, r4-r11, lr}}
    sub     sp, #WALK
    mov     r10, r0
    mov     r4, #END
    add     r5, sp, #HOME
    ldr     r6, =freshet_settle
    strd    r4, r5, [r5, #-8]
    str     r6, [r5, #4]
    ldm     r10, {{r0-r3}}
    b       2f

freshet_next:
    ldr     r10, [sp, #WALK]
    ldm     r10, {{r0-r4}}
1:  adds    r0, #{resonator}
    adds    r1, #{tuning}
    adds    r2, #{flow}
    adds    r3, #8
    subs    r4, #1
    stm     r10, {{r0-r4}}
    beq     8f
@ r0 resonator  r1 tuning  r2 flow  r3 clock  r10 walk
2:  ldrd    r4, r5, [r2, #{coarse}]     @ and the crowd
    ldrd    r6, r7, [r3]
    ldr     r9, [r2]                    @ per block
    orrs    r4, r5
    bne     9f
    subs    r4, r6, r9
    sbcs    r5, r7, #0
    blo     freshet_draw
    strd    r4, r5, [r3]
    ldr     r4, [r0, #{extent}]
    cmp     r4, #0
    bne     freshet_whole
    ldr     r4, [r10, #16]
    b       1b
8:  movs    r1, #0
    b       freshet_stop
9:  movs    r1, #1
freshet_stop:
    add     sp, #WALK + 4
    pop     {{r4-r11, pc}}

@ Rings for a block without births.
freshet_whole:
    ldrb    r4, [r1, #{form}]
    str     r0, [sp, #HOME]
    mov     r12, r0
    ldr     r0, [r10, #OUT]
    add     sp, #STREAM
    cmp     r4, #{circle}
    bne     1f
    registers_circle {coefficients}
    b       freshet_circle
1:  registers_direct {coefficients}
    b       freshet_direct

freshet_draw:
    ldr     r1, [r10, #SOURCE]
    mov     r0, r2
    mov     r4, r6
    mov     r5, r7
    ldr     r11, [r1, #8]
    ldrd    r6, r7, [r1], #{list}
    cmp     r11, #{drawn}
    it      hi
    movhi   r11, #{drawn}
    str     r11, [sp]
    ldr     r8, =0x9e3779bb
    ldr     r10, ={neg_log2}
@ r0 stroke  r1 list  r4:r5 clock  r6, r7 random  r8 its factor  r9 per block  r10 table  r11 births left
1:  subs    r11, #1
    blo     4f
    mul     r2, r6, r8                  @ for the gap
    mul     r3, r7, r8                  @ for the rest
    eor     r7, r7, r6
    eor     r6, r7, r6, ror #6
    eor     r6, r6, r7, lsl #9
    ror     r7, r7, #19
    ldrd    r12, lr, [r0, #8]           @ stretch, silent below
    cmp     r3, lr
    blo     2f
    umull   lr, r12, r4, r12
    add     r12, r4
    strd    r12, r3, [r1], #8
2:  clz     r12, r2
    lsl     r2, r2, r12
    ubfx    lr, r2, #23, #8
    add     lr, r10, lr, lsl #3
    ldrd    r3, lr, [lr]
    add     r3, r3, r12, lsl #26
    smmla   r3, lr, r2, r3
    ldr     r12, [r0, #4]               @ gap
    umlal   r4, r5, r3, r12
    subs    r2, r4, r9
    sbcs    r3, r5, #0
    blo     1b
    mov     r4, r2
    mov     r5, r3
    movs    r2, #2
    b       5f
4:  movs    r2, #3
    mov     r11, #0
5:  ldr     r12, [sp, #WALK]
    ldr     r3, [r12, #12]
    strd    r4, r5, [r3]
    ldr     r3, [r12, #SOURCE]
    ldr     r4, [sp]
    ldr     r5, [r3, #8]
    sub     r4, r4, r11
    sub     r5, r5, r4
    str     r5, [r3, #8]
    strd    r6, r7, [r3], #{list}
    mvn     r4, #0
    str     r4, [r1, #4]                @ the end mark
    str     r1, [sp, #LIST_END]
    cmp     r2, #2
    bne     freshet_listed
    cmp     r1, r3
    beq     6f                          @ none to be heard
    mov     r1, r3
    ldr     r3, [r3, #12 - {list}]
    cmp     r3, #{strikes_max}
    it      hi
    movhi   r3, #{strikes_max}
    str     r3, [sp, #ROOM]
    ldr     r4, [r12, #4]
    mov     r2, sp
    ldrb    r4, [r4, #{form}]
    cmp     r4, #{circle}
    beq     freshet_strike_circle
    bhi     freshet_strike_direct
    b       freshet_unheard
6:  mov     r10, r12
    ldrd    r0, r1, [r10]
    ldr     r4, [r0, #{extent}]
    cmp     r4, #0
    bne     freshet_whole
    b       freshet_next

@ Ends a class's block; its words are r0 out, and r12 points home.
    .type   freshet_settle, %function
    .thumb_func
freshet_settle:
    sub     r1, r12, #HOME
    ldr     r12, [r12, #8]
    mov     sp, r1
    ldrd    r1, r2, [r12]
    ldrd    r3, r4, [r2, #{floor}]      @ and the swing
    cmp     r0, r3
    bls     1f
    str     r0, [r1, #{extent}]
    lsrs    r0, r0, #3
    ldrd    r2, r3, [r12, #SWING]
    adds    r0, #1
    umlal   r2, r3, r0, r4
    strd    r2, r3, [r12, #SWING]
    b       freshet_next
1:  movs    r2, #0
    movs    r3, #0
    strd    r2, r3, [r1]
    strd    r2, r3, [r1, #8]
    strd    r2, r3, [r1, #16]
    strd    r2, r3, [r1, #24]
    str     r2, [r1, #{extent}]
    b       freshet_next

@ A bubble that there is no room for, or a class that is too high.
freshet_unheard:
    movs    r2, #2
    ldr     r12, [sp, #WALK]
    ldr     r3, [r12, #SOURCE]
    ldr     r1, [sp, #LIST_END]
    adds    r3, #{list}
freshet_listed:
    subs    r1, r1, r3
    lsrs    r0, r1, #3
    mov     r1, r2
    b       freshet_stop
    .ltorg

    .macro  strike form
freshet_strike_\form:
    first_\form -1
@ r0 stroke  r1 list  r2 stream  r3 room  r4 see enter
1:  ldrd    r5, r6, [r1], #8            @ position, random bits
    ldrd    r7, r8, [r0, #16]           @ still, exponent
    cmp     r6, r7
    bhi     2f
    clz     r9, r6
    lsl     r7, r6, r9
    ubfx    r10, r7, #23, #8
    ldr     r11, ={neg_log2}
    add     r10, r11, r10, lsl #3
    ldrd    r10, r11, [r10]
    add     r10, r10, r9, lsl #26
    smmla   r10, r11, r7, r10
    umull   r9, r7, r10, r8             @ softness
    mvn     r8, r5, lsl #5              @ the rest of the sample
    ldrd    r9, r10, [r0, #24]          @ decay, step
    umull   r11, r12, r9, r8
    add     r7, r7, r12, lsr #11
    umull   r11, r12, r10, r8
    sub     r12, r12, r10               @ phase
    lsl     r8, r7, #12
    lsr     r9, r8, #24
    ldr     r10, ={exp2_neg}
    add     r9, r10, r9, lsl #3
    ldrd    r9, r10, [r9]
    umull   r11, r10, r10, r8
    sub     r9, r9, r10
    lsr     r7, r7, #20
    lsr     r9, r9, r7
    ldr     r7, [r0, #40]
    umull   r11, r9, r9, r7             @ pressure
    subs    r3, r3, r9, lsr #2
    blo     freshet_unheard
    ubfx    r6, r6, #4, #8
    ldrd    r7, r8, [r0, #32]           @ width, edge
    mla     r6, r6, r7, r8
    ubfx    r6, r6, #8, #8
    ldr     r7, ={pan}
    add     r6, r7, r6, lsl #3
    ldrd    r7, r6, [r6]
    umull   r11, r7, r7, r9             @ left
    umull   r11, r6, r6, r9             @ right
    add     r8, r12, #0x200000
    lsr     r8, r8, #22
    ldr     r9, ={sine_cosine}
    add     r8, r9, r8, lsl #3
    ldrd    r8, r9, [r8]
    lsl     r10, r12, #10
    ldr     r11, =26353589              @ 2 pi, Q22
    smmulr  r10, r10, r11
    smmlar  r11, r10, r9, r8            @ sine, the first word
    smmlsr  r9, r10, r8, r9             @ cosine
    ldrd    r8, r10, [r0, #44]
    smull   r12, lr, r8, r11
    smlal   r12, lr, r10, r9
    lsl     lr, lr, #2
    orr     lr, lr, r12, lsr #30        @ the second word
    enter_\form 27
    b       1b

@ The end mark, or a bubble that rises.
2:  ldr     r7, [sp, #LIST_END]
    subs    r1, #8
    cmp     r1, r7
    bne     freshet_unheard
    ldr     r12, [sp, #WALK]
    ldr     r8, [sp, #ROOM]
    ldr     r7, [r12, #SOURCE]
    sub     r8, r8, r3
    ldr     r9, [r7, #12]
    sub     r9, r9, r8
    str     r9, [r7, #12]
    mov     r11, #END
    add     lr, sp, #HOME
    end_\form
    ldr     r0, [r12, #OUT]
    ldrd    r12, r1, [r12]
    str     r12, [sp, #HOME]
    registers_\form {coefficients}
    pop     {{pc}}
    .ltorg
    .endm

    strike  circle
    strike  direct
    .size   freshet_walk, . - freshet_walk

@ u32 freshet_ring(State *, const i32 coefficients[2], Frame *, const Hit *)
    .macro  ring form
    .section .text.freshet_ring_\form, "ax", %progbits
    .balign 16
    .global freshet_ring_\form
    .type   freshet_ring_\form, %function
    .thumb_func
freshet_ring_\form:
    ldr     r12, =freshet_rung
    push    {{r1, r2, r4-r11, lr}}
    push    {{r0, r12}}
    sub     sp, #STREAM
    mov     r2, sp
    first_\form 0
1:  ldm     r3!, {{r5, r6, r7, r11, lr}}
    enter_\form 26
    cmp     r11, #END
    bne     1b
    add     lr, sp, #STREAM
    str     lr, [r2, #-4]
    ldr     r12, [lr]
    ldrd    r1, r0, [lr, #8]
    registers_\form 0
    pop     {{pc}}
    .ltorg
    .balign 16
    .endm

    ring    circle
    .type   freshet_circle, %function
    .thumb_func
freshet_circle:
    .rept   32
    ldrd    r12, lr, [r0]
    smlal   r6, r7, r3, r7
    smlal   r10, r11, r3, r11
    smlal   r6, r7, r2, r5
    smlal   r10, r11, r2, r9
    smlal   r4, r5, r1, r7
    smlal   r8, r9, r1, r11
    add     r12, r5
    add     lr, r9
    strd    r12, lr, [r0], #8
    .endr
    .type   freshet_circle_hit, %function
    .thumb_func
freshet_circle_hit:
    ldrd    r12, lr, [sp, #4]           @ left, first
    cmp     lr, #END
    beq     1f
    smlal   r4, r5, r12, lr
    ldr     r12, [sp]                   @ right
    smlal   r8, r9, r12, lr
    ldr     lr, [sp, #12]               @ second
    smlal   r10, r11, r12, lr
    ldr     r12, [sp, #4]
    smlal   r6, r7, r12, lr
    add     sp, #16
    pop     {{pc}}
1:  ldr     r12, [sp, #12]              @ home
    ldrd    r0, lr, [r12]
    stm     r0, {{r4-r11}}
    eor     r0, r5, r5, asr #31
    eor     r1, r7, r7, asr #31
    orrs    r0, r1
    eor     r1, r9, r9, asr #31
    orrs    r0, r1
    eor     r1, r11, r11, asr #31
    orrs    r0, r1
    bx      lr
    .type   freshet_rung, %function
    .thumb_func
freshet_rung:
    mov     sp, r12
    add     sp, #16
    pop     {{r4-r11, pc}}
    .size   freshet_ring_circle, . - freshet_ring_circle

    .macro  direct y, y1, out
    smull   r3, r12, r1, \y
    smlal   r3, r12, r2, \y1
    lsl     \y1, r12, #2
    orr     \y1, \y1, r3, lsr #30
    add     \out, \y1
    .endm
    ring    direct
    .type   freshet_direct, %function
    .thumb_func
freshet_direct:
    .rept   16
    ldm.w   r0, {{r8-r11}}
    direct  r4, r5, r8
    direct  r6, r7, r9
    direct  r5, r4, r10
    direct  r7, r6, r11
    stm.w   r0!, {{r8-r11}}
    .endr
    .type   freshet_direct_hit, %function
    .thumb_func
freshet_direct_hit:
    ldm     sp, {{r8-r11}}              @ right, left, first, second
    cmp     r10, #END
    beq     1f
    smmla   r4, r10, r9, r4
    smmla   r5, r11, r9, r5
    smmla   r6, r10, r8, r6
    smmla   r7, r11, r8, r7
    add     sp, #16
    pop     {{pc}}
1:  mov     r12, r11                    @ home
    ldrd    r0, lr, [r12]
    str     r4, [r0, #4]
    str     r5, [r0, #12]
    str     r6, [r0, #20]
    str     r7, [r0, #28]
    eor     r0, r4, r4, asr #31
    eor     r1, r5, r5, asr #31
    orrs    r0, r1
    eor     r1, r6, r6, asr #31
    orrs    r0, r1
    eor     r1, r7, r7, asr #31
    orrs    r0, r1
    bx      lr
@ The one frame too many for a loop of pairs.
    .type   freshet_direct_odd, %function
    .thumb_func
freshet_direct_odd:
    ldrd    r8, r9, [r0]
    smull   r3, r12, r1, r4
    smlal   r3, r12, r2, r5
    mov     r5, r4
    lsl     r4, r12, #2
    orr     r4, r4, r3, lsr #30
    add     r8, r4
    smull   r3, r12, r1, r6
    smlal   r3, r12, r2, r7
    mov     r7, r6
    lsl     r6, r12, #2
    orr     r6, r6, r3, lsr #30
    add     r9, r6
    strd    r8, r9, [r0], #8
    pop     {{pc}}
    .size   freshet_ring_direct, . - freshet_ring_direct

    .purgem enter_circle
    .purgem first_circle
    .purgem place_direct
    .purgem enter_direct
    .purgem end_circle
    .purgem end_direct
    .purgem first_direct
    .purgem registers_circle
    .purgem registers_direct
    .purgem strike
    .purgem ring
    .purgem direct
    .text
